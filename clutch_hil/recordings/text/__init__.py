"""What the text format is made of: the lines of a file, their layout, and the cells: numbers, flags and times."""
