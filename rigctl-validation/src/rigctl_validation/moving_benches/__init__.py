"""Moving twins of the small benches: the same equations under an excitation that never rests.

The generator shares no equation, no integrator and no line of code with the models that
are tested on its data.
"""
