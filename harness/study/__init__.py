"""Studies: accuracy of criteria as predictors of cost, and gains of better triangulations."""
