"""A page that measures: a run's frames and triangulations, drawn by whatever browser opens it."""
