"""A frozen model by ctypes, without pmalpha: prints the first output after some fine steps.

python ctypes_loop.py libpmalpha.so model.pma 1000
"""

import sys
from ctypes import CDLL, byref, c_char_p, c_double, c_int, c_size_t, c_void_p
from ctypes import create_string_buffer as buffer

library, path, steps = CDLL(sys.argv[1]), sys.argv[2], int(sys.argv[3])
library.pmalpha_open.argtypes = [c_char_p, c_char_p, c_void_p]
library.pmalpha_command.argtypes = [c_void_p, c_int, c_void_p]
library.pmalpha_set.argtypes = [c_void_p, c_int, c_double]
library.pmalpha_advance.argtypes = [c_void_p, c_size_t]
library.pmalpha_get.argtypes, library.pmalpha_get.restype = [c_void_p, c_int], c_double
library.pmalpha_close.argtypes = [c_void_p]

model, why, d = c_void_p(), buffer(256), (c_double * 3)()
if library.pmalpha_open(path.encode(), why, byref(model)) != 0:
    sys.exit(why.value.decode())
for _ in range(steps):
    library.pmalpha_command(model, 0, d)
    if library.pmalpha_set(model, 0, 300.0 * d[0]) or library.pmalpha_advance(model, 1):
        sys.exit("the step failed")
print(repr(library.pmalpha_get(model, 0)))
library.pmalpha_close(model)
