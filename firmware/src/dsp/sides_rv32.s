// Places with two registers for their west and east in turn, and nothing to move but the pointers to their sides.
.macro even node
    place \node, {a}, {b}
.endm
.macro odd node
    place \node, {b}, {a}
.endm
.macro step
    addi {east}, {east}, 64
    addi {north}, {north}, 64
    addi {south}, {south}, 64
.endm
