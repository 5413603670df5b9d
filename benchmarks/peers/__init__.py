"""The same closed loop in other tools, to compare speed with; none of them imports agvjax.

Every module has one `contestant(values, *, dt, n_steps, dtype)`. It prepares and compiles, and returns a function that
simulates all scenarios once, on one thread, and returns the total RMSE of each.
"""
