"""From a surface to a quad mesh: lines of curvature, their crossings, their cells."""
