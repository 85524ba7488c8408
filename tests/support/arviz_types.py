"""Results in the types of the installed ArviZ."""


def for_arviz(tree):
    """Return a result as InferenceData (ArviZ 0.23) or as the tree itself (1.x)."""
    import arviz

    if not arviz.__version__.startswith("0."):
        return tree
    return arviz.InferenceData(
        attrs=dict(tree.attrs), **{name: one.to_dataset() for name, one in tree.children.items()}
    )
