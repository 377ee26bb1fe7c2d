"""Services of the machine for all packages: atomic files, locks, processes, cores, compiled code, clocks.

Nothing is imported here: the program looks after signals before anything heavy is loaded.
"""
