"""An emulated JR3 receiver, to be reached as ``tcp://host:port``.

It shares the memory map and the word protocol with the driver, and no arithmetic: a common error would not be seen.
"""
