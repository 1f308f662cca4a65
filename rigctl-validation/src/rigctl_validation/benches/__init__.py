"""Ten small benches unlike the shipped one, each with its own generator, and the files a user would write.

A generator is a few lines of NumPy and SciPy: it shares no equation, no integrator and no line of code with
the models that are tested on its data. The folder ``files`` has the family, the rig and the model as a user
would write them with the how-to guides. Each bench can hide one effect that its family lacks.
"""
