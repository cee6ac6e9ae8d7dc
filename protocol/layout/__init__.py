"""The normative layout of every byte that travels, as construct definitions: one module for each part of SPEC.md.

Integers are little-endian unless a name says otherwise. These definitions are the reference; where a faster twin
exists beside them, tests hold the two together.
"""
