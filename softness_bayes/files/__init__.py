"""Files that are written: whole or not at all, never over anybody else's, and safe to open in a spreadsheet."""
