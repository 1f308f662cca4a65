"""A second bench that shares no code with the engine, the physics or the effects of the tool.

Its base is an independent implementation of the bench's published model, with another integrator; its hidden
effects have other shapes than those of the tool's library. Data from it can prove the tool wrong.
"""
