// A place, `node` bytes from where the pointers are. `west` has its west before and is lost; `east` becomes the next
// place's west.
.macro place node, west, east
    ldr r0, [{each}, #\node]
    ldr \east, [{east}, #\node]
    cbz r0, 99f
    ldr {x}, [{north}, #\node]
    ldr {y}, [{south}, #\node]
    add \west, \east
    add {x}, {y}
    add \west, {x}
    // Twice the bracket.
    ldrd {p}, {y}, [{own}, #\node]
    add \west, {y}, \west, lsl #1
    // A step of 1 or more is one less as a signed number.
    and {x}, \west, r0, asr #31
    smmla \west, \west, r0, {x}
    umull {x}, {y}, {p}, {overshoot}
    sub \west, {y}
    // The lower limit of a red node, the upper one of a black one, which is not above 0 before.
.if {red}
    bic {p}, \west, \west, asr #31
.else
    and {x}, {overshoot}, {p}, asr #31
    add \west, {x}
    and {p}, \west, \west, asr #31
.endif
    str {p}, [{own}, #\node]
99:
.endm

    cmp {x}, #4
    bgt 2f
    beq 14f
    cmp {x}, #2
    blt 11f
    beq 12f
    b 13f
2:  cmp {x}, #6
    blt 15f
    beq 16f
    cmp {x}, #7
    beq 17f
    b 18f
3:  add {each}, #64
    add {own}, #64
    add {east}, #64
    add {north}, #64
    add {south}, #64
    place 0, {a}, {b}
11: place 8, {b}, {a}
12: place 16, {a}, {b}
13: place 24, {b}, {a}
14: place 32, {a}, {b}
15: place 40, {b}, {a}
16: place 48, {a}, {b}
17: place 56, {b}, {a}
18: cmp {own}, {end}
    bne 3b
.purgem place
