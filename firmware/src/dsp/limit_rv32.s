// A doubled piston `p` that has taken its step: the upper limit, the lower one, and rounding.
.macro limit p, s, t
    srai \s, \p, 31
    and \p, \p, \s
    add \s, \p, {room}
    srai \t, \s, 31
    and \s, \s, \t
    sub \p, \p, \s
    ori \p, \p, 1
.endm
