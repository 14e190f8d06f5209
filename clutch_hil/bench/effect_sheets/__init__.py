"""The effects shown to people: demonstrations as text, pictures and a page."""
