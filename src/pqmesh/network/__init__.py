"""From a surface to a quad mesh: networks of curves, their crossings, their cells."""
