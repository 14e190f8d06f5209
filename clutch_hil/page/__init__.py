"""Page: common parts of all HTML reports: elements, style, figures, wording of numbers."""
