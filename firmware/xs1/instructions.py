"""The instruction set of the XMOS XS1, as one table that assembler, disassembler and interpreter share.

Each instruction has a name of its own, a syntax, a format and an opcode. The syntax is a template: capital letters
stand for operands, and everything else stands for itself. `encoding` puts operands into the bits of a format and takes
them out again.

Sources: the architecture's public description ("The XMOS XS1 Architecture", D. May), and what LLVM's disassembler for
XCore says of every encoding, which `tests/firmware/xs1/test_encoding.py` compares with.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

__all__ = [
    "ALIASES",
    "BIT_POSITIONS",
    "BY_NAME",
    "INSTRUCTIONS",
    "REGISTERS",
    "Effect",
    "Format",
    "Instruction",
]

REGISTERS = (*(f"r{number}" for number in range(12)), "cp", "dp", "sp", "lr")
"""By number. Formats with several registers reach the first 12 only."""

BIT_POSITIONS = (32, 1, 2, 3, 4, 5, 6, 7, 8, 16, 24, 32)
"""What a bit position (operand P) means, by its code. 32 has two codes; the assembler writes the higher one."""


class Format(Enum):
    """How an instruction lies in one or two half words. Two operands of 0 to 11 share 5 bits for their high halves."""

    F3R = "three operands, 5 bits of opcode"
    F2R = "two operands, 6 bits of opcode"
    F1R = "one operand, 6 bits of opcode"
    F0R = "no operand, 10 bits of opcode"
    FRU6 = "a register and an immediate of 6 bits, or of 16 with a prefix; 6 bits of opcode"
    FU6 = "an immediate of 6 bits, or of 16 with a prefix; 10 bits of opcode"
    FU10 = "an immediate of 10 bits, or of 20 with a prefix; 6 bits of opcode"
    FL3R = "two half words, three operands, 9 bits of opcode"
    FL2R = "two half words, two operands, 10 bits of opcode"
    FL4R = "two half words, four operands, 6 bits of opcode"
    FL5R = "two half words, five operands, 6 bits of opcode"
    FL6R = "two half words, six operands, 5 bits of opcode"


class Effect(Enum):
    """What an instruction does besides computing in registers."""

    NONE = "registers only"
    LOAD = "reads memory"
    STORE = "writes memory"
    BRANCH = "may change the program counter"
    RESOURCE = "acts on a port, timer, channel end, lock or clock, or waits"
    THREAD = "acts on a thread"
    KERNEL = "enters or leaves the kernel, or reads or writes its registers"


class Instruction(NamedTuple):
    """One row of the table.

    Parameters
    ----------
    name : str
        Unique.
    syntax : str
        Mnemonic and operands. A to F are registers in the order of the format's fields. U is a number of 0 to 11 and P
        a bit position, either in the last field. N is the immediate. T is a branch's distance in half words from the
        end of the instruction, with the sign that the opcode says.
    format : Format
    opcode : int
    effect : Effect
    backwards : bool
        Whether T counts backwards.
    """

    name: str
    syntax: str
    format: Format
    opcode: int
    effect: Effect = Effect.NONE
    backwards: bool = False

    @property
    def mnemonic(self) -> str:
        """The first word of the syntax."""
        return self.syntax.split()[0]


_F = Format
_E = Effect
_I = Instruction

INSTRUCTIONS = (
    # Three operands
    _I("stwi", "stw A, B[U]", _F.F3R, 0b00000, _E.STORE),
    _I("ldwi", "ldw A, B[U]", _F.F3R, 0b00001, _E.LOAD),
    _I("add", "add A, B, C", _F.F3R, 0b00010),
    _I("sub", "sub A, B, C", _F.F3R, 0b00011),
    _I("shl", "shl A, B, C", _F.F3R, 0b00100),
    _I("shr", "shr A, B, C", _F.F3R, 0b00101),
    _I("eq", "eq A, B, C", _F.F3R, 0b00110),
    _I("and", "and A, B, C", _F.F3R, 0b00111),
    _I("or", "or A, B, C", _F.F3R, 0b01000),
    _I("ldw", "ldw A, B[C]", _F.F3R, 0b01001, _E.LOAD),
    _I("ld16s", "ld16s A, B[C]", _F.F3R, 0b10000, _E.LOAD),
    _I("ld8u", "ld8u A, B[C]", _F.F3R, 0b10001, _E.LOAD),
    _I("addi", "add A, B, U", _F.F3R, 0b10010),
    _I("subi", "sub A, B, U", _F.F3R, 0b10011),
    _I("shli", "shl A, B, P", _F.F3R, 0b10100),
    _I("shri", "shr A, B, P", _F.F3R, 0b10101),
    _I("eqi", "eq A, B, U", _F.F3R, 0b10110),
    _I("tsetr", "set t[C]:A, B", _F.F3R, 0b10111, _E.THREAD),
    _I("lss", "lss A, B, C", _F.F3R, 0b11000),
    _I("lsu", "lsu A, B, C", _F.F3R, 0b11001),
    # Two operands
    _I("tinitpc", "init t[B]:pc, A", _F.F2R, 0b000000, _E.THREAD),
    _I("getst", "getst A, res[B]", _F.F2R, 0b000001, _E.THREAD),
    _I("tinitdp", "init t[B]:dp, A", _F.F2R, 0b000010, _E.THREAD),
    _I("outt", "outt res[B], A", _F.F2R, 0b000011, _E.RESOURCE),
    _I("tinitsp", "init t[B]:sp, A", _F.F2R, 0b000100, _E.THREAD),
    _I("setd", "setd res[B], A", _F.F2R, 0b000101, _E.RESOURCE),
    _I("tinitcp", "init t[B]:cp, A", _F.F2R, 0b000110, _E.THREAD),
    _I("tsetmr", "tsetmr A, B", _F.F2R, 0b000111, _E.THREAD),
    _I("eet", "eet A, res[B]", _F.F2R, 0b001001, _E.RESOURCE),
    _I("andnot", "andnot A, B", _F.F2R, 0b001010),
    _I("eef", "eef A, res[B]", _F.F2R, 0b001011, _E.RESOURCE),
    _I("sext", "sext A, B", _F.F2R, 0b001100),
    _I("sexti", "sext A, P", _F.F2R, 0b001101),
    _I("getts", "getts A, res[B]", _F.F2R, 0b001110, _E.RESOURCE),
    _I("setpt", "setpt res[B], A", _F.F2R, 0b001111, _E.RESOURCE),
    _I("zext", "zext A, B", _F.F2R, 0b010000),
    _I("zexti", "zext A, P", _F.F2R, 0b010001),
    _I("outct", "outct res[A], B", _F.F2R, 0b010010, _E.RESOURCE),
    _I("outcti", "outct res[A], U", _F.F2R, 0b010011, _E.RESOURCE),
    _I("getr", "getr A, U", _F.F2R, 0b100000, _E.RESOURCE),
    _I("inct", "inct A, res[B]", _F.F2R, 0b100001, _E.RESOURCE),
    _I("not", "not A, B", _F.F2R, 0b100010),
    _I("int", "int A, res[B]", _F.F2R, 0b100011, _E.RESOURCE),
    _I("neg", "neg A, B", _F.F2R, 0b100100),
    _I("endin", "endin A, res[B]", _F.F2R, 0b100101, _E.RESOURCE),
    _I("mkmsk", "mkmsk A, B", _F.F2R, 0b101000),
    _I("mkmski", "mkmsk A, P", _F.F2R, 0b101001),
    _I("out", "out res[B], A", _F.F2R, 0b101010, _E.RESOURCE),
    _I("outshr", "outshr res[B], A", _F.F2R, 0b101011, _E.RESOURCE),
    _I("in", "in A, res[B]", _F.F2R, 0b101100, _E.RESOURCE),
    _I("inshr", "inshr A, res[B]", _F.F2R, 0b101101, _E.RESOURCE),
    _I("peek", "peek A, res[B]", _F.F2R, 0b101110, _E.RESOURCE),
    _I("testct", "testct A, res[B]", _F.F2R, 0b101111, _E.RESOURCE),
    _I("setpsc", "setpsc res[B], A", _F.F2R, 0b110000, _E.RESOURCE),
    _I("testwct", "testwct A, res[B]", _F.F2R, 0b110001, _E.RESOURCE),
    _I("chkct", "chkct res[A], B", _F.F2R, 0b110010, _E.RESOURCE),
    _I("chkcti", "chkct res[A], P", _F.F2R, 0b110011, _E.RESOURCE),
    # One operand
    _I("edu", "edu res[A]", _F.F1R, 0b000000, _E.RESOURCE),
    _I("eeu", "eeu res[A]", _F.F1R, 0b000001, _E.RESOURCE),
    _I("waitet", "waitet A", _F.F1R, 0b000010, _E.RESOURCE),
    _I("waitef", "waitef A", _F.F1R, 0b000011, _E.RESOURCE),
    _I("freer", "freer res[A]", _F.F1R, 0b000100, _E.RESOURCE),
    _I("mjoin", "mjoin res[A]", _F.F1R, 0b000101, _E.THREAD),
    _I("tstart", "start t[A]", _F.F1R, 0b000110, _E.THREAD),
    _I("msync", "msync res[A]", _F.F1R, 0b000111, _E.THREAD),
    _I("blar", "bla A", _F.F1R, 0b001000, _E.BRANCH),
    _I("bau", "bau A", _F.F1R, 0b001001, _E.BRANCH),
    _I("bru", "bru A", _F.F1R, 0b001010, _E.BRANCH),
    _I("setsp", "set sp, A", _F.F1R, 0b001011),
    _I("setdp", "set dp, A", _F.F1R, 0b001100),
    _I("setcp", "set cp, A", _F.F1R, 0b001101),
    _I("dgetreg", "dgetreg A", _F.F1R, 0b001110, _E.KERNEL),
    _I("setev", "setev res[A], r11", _F.F1R, 0b001111, _E.RESOURCE),
    _I("kcall", "kcall A", _F.F1R, 0b010000, _E.KERNEL),
    _I("setv", "setv res[A], r11", _F.F1R, 0b010001, _E.RESOURCE),
    _I("ecallf", "ecallf A", _F.F1R, 0b010010, _E.KERNEL),
    _I("ecallt", "ecallt A", _F.F1R, 0b010011, _E.KERNEL),
    _I("clrpt", "clrpt res[A]", _F.F1R, 0b100000, _E.RESOURCE),
    _I("syncr", "syncr res[A]", _F.F1R, 0b100001, _E.RESOURCE),
    # No operand
    _I("waiteu", "waiteu", _F.F0R, 0b0000001100, _E.RESOURCE),
    _I("clre", "clre", _F.F0R, 0b0000001101, _E.RESOURCE),
    _I("ssync", "ssync", _F.F0R, 0b0000001110, _E.THREAD),
    _I("freet", "freet", _F.F0R, 0b0000001111, _E.THREAD),
    _I("dcall", "dcall", _F.F0R, 0b0000011100, _E.KERNEL),
    _I("kret", "kret", _F.F0R, 0b0000011101, _E.KERNEL),
    _I("dret", "dret", _F.F0R, 0b0000011110, _E.KERNEL),
    _I("setkep", "set kep, r11", _F.F0R, 0b0000011111, _E.KERNEL),
    _I("ldspc", "ldw spc, sp[1]", _F.F0R, 0b0000101100, _E.KERNEL),
    _I("stspc", "stw spc, sp[1]", _F.F0R, 0b0000101101, _E.KERNEL),
    _I("ldssr", "ldw ssr, sp[2]", _F.F0R, 0b0000101110, _E.KERNEL),
    _I("stssr", "stw ssr, sp[2]", _F.F0R, 0b0000101111, _E.KERNEL),
    _I("stsed", "stw sed, sp[3]", _F.F0R, 0b0000111100, _E.KERNEL),
    _I("stet", "stw et, sp[4]", _F.F0R, 0b0000111101, _E.KERNEL),
    _I("geted", "get r11, ed", _F.F0R, 0b0000111110, _E.KERNEL),
    _I("getet", "get r11, et", _F.F0R, 0b0000111111, _E.KERNEL),
    _I("dentsp", "dentsp", _F.F0R, 0b0001001100, _E.KERNEL),
    _I("drestsp", "drestsp", _F.F0R, 0b0001001101, _E.KERNEL),
    _I("getid", "get r11, id", _F.F0R, 0b0001001110, _E.THREAD),
    _I("getkep", "get r11, kep", _F.F0R, 0b0001001111, _E.KERNEL),
    _I("getksp", "get r11, ksp", _F.F0R, 0b0001011100, _E.KERNEL),
    _I("ldsed", "ldw sed, sp[3]", _F.F0R, 0b0001011101, _E.KERNEL),
    _I("ldet", "ldw et, sp[4]", _F.F0R, 0b0001011110, _E.KERNEL),
    # A register and an immediate
    _I("stwdp", "stw A, dp[N]", _F.FRU6, 0b010100, _E.STORE),
    _I("stwsp", "stw A, sp[N]", _F.FRU6, 0b010101, _E.STORE),
    _I("ldwdp", "ldw A, dp[N]", _F.FRU6, 0b010110, _E.LOAD),
    _I("ldwsp", "ldw A, sp[N]", _F.FRU6, 0b010111, _E.LOAD),
    _I("ldawdp", "ldaw A, dp[N]", _F.FRU6, 0b011000),
    _I("ldawsp", "ldaw A, sp[N]", _F.FRU6, 0b011001),
    _I("ldc", "ldc A, N", _F.FRU6, 0b011010),
    _I("ldwcp", "ldw A, cp[N]", _F.FRU6, 0b011011, _E.LOAD),
    _I("brft", "bt A, T", _F.FRU6, 0b011100, _E.BRANCH),
    _I("brbt", "bt A, T", _F.FRU6, 0b011101, _E.BRANCH, backwards=True),
    _I("brff", "bf A, T", _F.FRU6, 0b011110, _E.BRANCH),
    _I("brbf", "bf A, T", _F.FRU6, 0b011111, _E.BRANCH, backwards=True),
    _I("setci", "setc res[A], N", _F.FRU6, 0b111010, _E.RESOURCE),
    # An immediate
    _I("brfu", "bu T", _F.FU6, 0b0111001100, _E.BRANCH),
    _I("blat", "blat N", _F.FU6, 0b0111001101, _E.BRANCH),
    _I("extdp", "extdp N", _F.FU6, 0b0111001110),
    _I("kcalli", "kcall N", _F.FU6, 0b0111001111, _E.KERNEL),
    _I("brbu", "bu T", _F.FU6, 0b0111011100, _E.BRANCH, backwards=True),
    _I("entsp", "entsp N", _F.FU6, 0b0111011101, _E.STORE),
    _I("extsp", "extsp N", _F.FU6, 0b0111011110),
    _I("retsp", "retsp N", _F.FU6, 0b0111011111, _E.BRANCH),
    _I("clrsr", "clrsr N", _F.FU6, 0b0111101100, _E.RESOURCE),
    _I("setsr", "setsr N", _F.FU6, 0b0111101101, _E.RESOURCE),
    _I("kentsp", "kentsp N", _F.FU6, 0b0111101110, _E.KERNEL),
    _I("krestsp", "krestsp N", _F.FU6, 0b0111101111, _E.KERNEL),
    _I("getsr", "getsr r11, N", _F.FU6, 0b0111111100),
    _I("ldawcp", "ldaw r11, cp[N]", _F.FU6, 0b0111111101),
    _I("blrf", "bl T", _F.FU10, 0b110100, _E.BRANCH),
    _I("blrb", "bl T", _F.FU10, 0b110101, _E.BRANCH, backwards=True),
    _I("ldapf", "ldap r11, T", _F.FU10, 0b110110),
    _I("ldapb", "ldap r11, T", _F.FU10, 0b110111, backwards=True),
    _I("blacp", "bla cp[N]", _F.FU10, 0b111000, _E.BRANCH),
    _I("ldwcpl", "ldw r11, cp[N]", _F.FU10, 0b111001, _E.LOAD),
    # Two half words: three operands
    _I("stwl", "stw A, B[C]", _F.FL3R, 0b000001100, _E.STORE),
    _I("xor", "xor A, B, C", _F.FL3R, 0b000011100),
    _I("ashr", "ashr A, B, C", _F.FL3R, 0b000101100),
    _I("ldawf", "ldaw A, B[C]", _F.FL3R, 0b000111100),
    _I("ldawb", "ldaw A, B[-C]", _F.FL3R, 0b001001100),
    _I("lda16f", "lda16 A, B[C]", _F.FL3R, 0b001011100),
    _I("lda16b", "lda16 A, B[-C]", _F.FL3R, 0b001101100),
    _I("mul", "mul A, B, C", _F.FL3R, 0b001111100),
    _I("divs", "divs A, B, C", _F.FL3R, 0b010001100),
    _I("divu", "divu A, B, C", _F.FL3R, 0b010011100),
    _I("st16", "st16 A, B[C]", _F.FL3R, 0b100001100, _E.STORE),
    _I("st8", "st8 A, B[C]", _F.FL3R, 0b100011100, _E.STORE),
    _I("ashri", "ashr A, B, P", _F.FL3R, 0b100101100),
    _I("outpw", "outpw res[B], A, P", _F.FL3R, 0b100101101, _E.RESOURCE),
    _I("inpw", "inpw A, res[B], P", _F.FL3R, 0b100101110, _E.RESOURCE),
    _I("ldawfi", "ldaw A, B[U]", _F.FL3R, 0b100111100),
    _I("ldawbi", "ldaw A, B[-U]", _F.FL3R, 0b101001100),
    _I("crc32", "crc32 A, B, C", _F.FL3R, 0b101011100),
    _I("rems", "rems A, B, C", _F.FL3R, 0b110001100),
    _I("remu", "remu A, B, C", _F.FL3R, 0b110011100),
    # Two half words: two operands
    _I("bitrev", "bitrev A, B", _F.FL2R, 0b0000011000),
    _I("byterev", "byterev A, B", _F.FL2R, 0b0000011001),
    _I("clz", "clz A, B", _F.FL2R, 0b0000111000),
    _I("setclk", "setclk res[B], A", _F.FL2R, 0b0000111001, _E.RESOURCE),
    _I("tinitlr", "init t[B]:lr, A", _F.FL2R, 0b0001011000, _E.THREAD),
    _I("getps", "get A, ps[B]", _F.FL2R, 0b0001011001, _E.KERNEL),
    _I("setps", "set ps[B], A", _F.FL2R, 0b0001111000, _E.KERNEL),
    _I("getd", "getd A, res[B]", _F.FL2R, 0b0001111001, _E.RESOURCE),
    _I("testlcl", "testlcl A, res[B]", _F.FL2R, 0b0010011000, _E.RESOURCE),
    _I("settw", "settw res[B], A", _F.FL2R, 0b0010011001, _E.RESOURCE),
    _I("setrdy", "setrdy res[B], A", _F.FL2R, 0b0010111000, _E.RESOURCE),
    _I("setc", "setc res[A], B", _F.FL2R, 0b0010111001, _E.RESOURCE),
    _I("setn", "setn res[B], A", _F.FL2R, 0b0011011000, _E.RESOURCE),
    _I("getn", "getn A, res[B]", _F.FL2R, 0b0011011001, _E.RESOURCE),
    # Two half words: four, five and six operands
    _I("crc8", "crc8 D, A, B, C", _F.FL4R, 0b000000),
    _I("maccu", "maccu A, D, B, C", _F.FL4R, 0b000001),
    _I("maccs", "maccs A, D, B, C", _F.FL4R, 0b000010),
    _I("ldivu", "ldivu A, D, E, B, C", _F.FL5R, 0b000000),
    _I("ladd", "ladd D, A, B, C, E", _F.FL5R, 0b000001),
    _I("lsub", "lsub D, A, B, C, E", _F.FL5R, 0b000010),
    _I("lmul", "lmul A, D, B, C, E, F", _F.FL6R, 0b00000),
)

BY_NAME = {instruction.name: code for code, instruction in enumerate(INSTRUCTIONS)}
"""The place of each instruction in the table, which is its code in predecoded programs."""

ALIASES = {"mov A, B": ("addi", 0)}
"""Other spellings: the instruction that is meant, and what stands for its operand U."""
