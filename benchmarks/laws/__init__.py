"""How right are the exponents that a diagnosis claims?"""
