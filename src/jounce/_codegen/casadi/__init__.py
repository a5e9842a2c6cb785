"""Functions of a robot's quantities for CasADi, and C that CasADi loads.

`function` is the door of `Robot.casadi_function`: an expression graph of symbols, or `native`, native code as a
callback. `external` is what generated C holds: a quantity, its Jacobian, its gradients, and their Jacobian; it
says how arrays of jounce lie in matrices of CasADi.
"""
