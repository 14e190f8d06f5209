"""Page: what every HTML report shares: elements, style, figures, wording of numbers."""
