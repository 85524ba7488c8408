"""Files that are written whole or not at all, never replace other files, and are safe to open in a spreadsheet."""
