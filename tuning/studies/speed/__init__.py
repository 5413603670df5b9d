"""How fast can it go, and which place on the route limits it?"""
