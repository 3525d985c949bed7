"""Studies: accuracy of criteria as predictors of cost, Pareto fronts, and replication."""
