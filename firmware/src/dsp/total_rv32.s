// The square of r / 8 from 8 r in `r`, and the piston `p`: all of it, and that without the lowest bits.
.macro total r, p, s, t
    srai \r, \r, 6
    mul \s, \r, \r
    mulh \t, \r, \r
    add {squares_low}, {squares_low}, \s
    sltu \s, {squares_low}, \s
    add {squares_high}, {squares_high}, \t
    add {squares_high}, {squares_high}, \s
    add {low}, {low}, \p
    srai \p, \p, 14
    add {high}, {high}, \p
.endm
