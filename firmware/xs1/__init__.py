"""The XMOS XS1: its instructions, an assembler and a disassembler for them, and a core that executes them.

This room knows a processor, and nothing of what its programs do. `instructions` is the table that all others share.
`assembler` makes a program of sources, `disassembler` text of a program. `core` executes one, thread by thread and
cycle by cycle, and `switch` configures its links. Import from these modules: only `core` and `execution` need numba.
"""
