"""Which law is better at the same command budget?"""
