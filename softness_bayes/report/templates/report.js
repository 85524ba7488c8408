"use strict";
// The charts are drawn as the first load on the first axis; each switch hands them other columns.
(function () {
  const { labels, shown } = JSON.parse(document.getElementById("payload").textContent);
  const controls = document.querySelector(".controls");

  function model(name) {
    for (const drawn of Bokeh.documents) {
      const found = drawn.get_model_by_name(name);
      if (found !== null) return found;
    }
    throw new Error(`no model ${name}`);
  }

  // JSON has no number for what nobody rated
  function numbers(columns) {
    const known = ([name, values]) => [name, values.map((value) => (value === null ? NaN : value))];
    return Object.fromEntries(Object.entries(columns).map(known));
  }

  function show() {
    const chosen = new FormData(controls);
    const now = shown[chosen.get("axis")][Number(chosen.get("load"))];
    for (const name of ["rate", "rating"]) {
      const chart = model(name);
      chart.title.text = now.title;
      chart.below.find((axis) => axis.axis_label !== undefined).axis_label = labels[chosen.get("axis")];
      [chart.x_range.start, chart.x_range.end] = now.ends;
      model(`${name}/band`).data = numbers(now[name]);
      model(`${name}/turn`).data = now.turn;
      model(`${name}/fabrics`).data = numbers(now.fabrics);
    }
    document.getElementById("turn").textContent = now.sentence;
  }

  controls.addEventListener("change", show);
})();
