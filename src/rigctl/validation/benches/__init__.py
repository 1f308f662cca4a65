"""Ten small benches that are nobody's cylinder, each with its own generator, and what a user writes of them.

A generator is a few lines of NumPy and SciPy: it shares no equation, no integrator and no line of code with
the models that judge its data. Beside it, in ``files``, stand the family, the rig and the model as a user
writes them after the how-tos. Each bench can hide one effect that its family lacks.
"""
