"""What all packages need of the machine: whole files, locks, processes, cores, compiled code, clocks.

Nothing is imported here: the program looks after signals before anything heavy is loaded.
"""
