"""Excel workbooks: one of their sheets as rows of text, which the reader of text files reads."""
