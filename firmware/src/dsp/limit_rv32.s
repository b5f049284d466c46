// The lower limit of a red node's `u`, the upper one of a black one's.
.macro limit u, t
.if {red}
    sgtz \t, \u
    mul \u, \u, \t
.else
    srai \t, \u, 31
    and \u, \u, \t
.endif
.endm
