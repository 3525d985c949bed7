"""Plots and heatmaps, and the style that all of them share."""
