"""The ground of every room: errors, kinds of options, prior laws, formatting, files."""
