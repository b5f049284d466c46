// The square of r / 8 from 2 r in `r`, and `u`: all of it, and that without the lowest bits. Both are lost.
.macro total r, u, s, t
    srai \r, \r, 4
    mul \s, \r, \r
    mulh \t, \r, \r
    add {squares_low}, {squares_low}, \s
    sltu \s, {squares_low}, \s
    add {squares_high}, {squares_high}, \t
    add {squares_high}, {squares_high}, \s
    add {low}, {low}, \u
    srai \u, \u, 14
    add {high}, {high}, \u
.endm
