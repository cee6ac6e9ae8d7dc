from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.ed448 import Ed448PrivateKey
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)
from phasewire.base.errors import InputFileError
from phasewire.host.firmware.keys import (
    MAKE_PRIVATE_KEY,
    MAKE_PUBLIC_KEY,
    judge,
    judge_file,
    read_private_key,
    read_public_keys,
)
from phasewire.protocol.codes import Target
from phasewire.protocol.firmware import Image, Segment, Signature, Suffix, build, sign, with_suffix
from phasewire.protocol.versions import Version

# RFC 8032, section 7.1, test 1.
SECRET = bytes.fromhex("9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60")
PUBLIC = bytes.fromhex("d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a")
KEY = Ed25519PrivateKey.from_private_bytes(SECRET)
IMAGE = Image(Version(1, 0, 0), (Segment(Target.ALL_PROCESSORS, b"p"), Segment(Target.CONTROLLER, b"c")))
PLAIN = NoEncryption()


def private_pem(key: Ed25519PrivateKey | Ed448PrivateKey | ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, PLAIN)


def public_pem(key: Ed25519PrivateKey | Ed448PrivateKey | ec.EllipticCurvePrivateKey) -> bytes:
    return key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "some.pem"


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")
def test_what_the_help_says_makes_keys(tmp_path: Path) -> None:
    for command in (MAKE_PRIVATE_KEY, MAKE_PUBLIC_KEY):
        subprocess.run(command.split(), cwd=tmp_path, check=True, timeout=30, capture_output=True)
    key = read_private_key(tmp_path / "key.pem")
    (public,) = read_public_keys([tmp_path / "public.pem"])
    assert judge(sign(IMAGE, key), [public]).trusted


P256 = ec.generate_private_key(ec.SECP256R1())
ED448 = Ed448PrivateKey.generate()
ENCRYPTED = KEY.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b"secret"))
X448_OF_32_BYTES = (  # its length is that of another algorithm, which OpenSSL reports as an internal error
    b"-----BEGIN PRIVATE KEY-----\nMC4CAQAwBQYDK2VvBCIEIAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA\n"
    b"-----END PRIVATE KEY-----\n"
)
OPENSSH = KEY.private_bytes(Encoding.PEM, PrivateFormat.OpenSSH, PLAIN)


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (b"", "holds no private key in PEM; this makes one: openssl genpkey"),
        (b"\xff" * 1000, "holds no private key"),
        (KEY.private_bytes(Encoding.DER, PrivateFormat.PKCS8, PLAIN), "holds no private key in PEM"),
        (private_pem(KEY)[:60], "holds no private key"),
        (private_pem(KEY).replace(b"MC4C", b"MC4D"), "holds no private key"),
        (OPENSSH, "holds no private key in PEM"),
        (X448_OF_32_BYTES, "holds no private key in PEM"),
        (public_pem(KEY), "holds a public key; who signs needs the private one"),
        (ENCRYPTED, r"is encrypted; decrypt it first: openssl pkey -in \S+some.pem"),
        (private_pem(P256), "of another kind, ECPrivateKey; images are signed with Ed25519"),
        (private_pem(ED448), "of another kind, Ed448PrivateKey"),
    ],
)
def test_a_file_without_a_usable_private_key_is_refused_with_advice(path: Path, content: bytes, match: str) -> None:
    path.write_bytes(content)
    with pytest.raises(InputFileError, match=match) as refused:
        read_private_key(path)
    assert str(path) in str(refused.value)


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (b"", "holds no public key in PEM; this makes one of a private key: openssl pkey"),
        (public_pem(KEY)[:60], "holds no public key"),
        (KEY.public_key().public_bytes(Encoding.OpenSSH, PublicFormat.OpenSSH), "holds no public key"),
        (private_pem(KEY), "holds a private key; its public half is enough"),
        (ENCRYPTED, "holds a private key"),
        (public_pem(P256), "of another kind, ECPublicKey"),
    ],
)
def test_a_file_without_a_usable_public_key_is_refused_with_advice(path: Path, content: bytes, match: str) -> None:
    path.write_bytes(content)
    with pytest.raises(InputFileError, match=match) as refused:
        read_public_keys([path])
    assert str(path) in str(refused.value)


def test_the_four_cases_of_a_signature() -> None:
    """Clause FWU-012."""
    public, stranger = KEY.public_key(), Ed25519PrivateKey.generate().public_key()
    signed = sign(IMAGE, KEY)
    assert signed.signature is not None
    number = signed.signature.key_id.hex()
    forged = Image(IMAGE.version, IMAGE.segments, signature=Signature(signed.signature.key_id, bytes(64)))
    verdicts = [judge(image, [stranger, public]) for image in (signed, IMAGE, forged)] + [judge(signed, [stranger])]
    assert [verdict.outcome for verdict in verdicts] == ["SIGNED", "UNSIGNED", "SIGNATURE", "UNKNOWN_KEY"]
    assert [verdict.trusted for verdict in verdicts] == [True, False, False, False]
    assert [number in verdict.words for verdict in verdicts] == [True, False, True, True]
    assert judge(forged, []).outcome == "UNKNOWN_KEY"  # without the key the two look the same


def flipped(data: bytes, bit: int) -> bytes:
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def test_a_flipped_bit_anywhere_is_refused() -> None:
    """Every bit of the file, and every bit of the image with a correct suffix after it."""
    keys, file = [KEY.public_key()], build(IMAGE, KEY)
    assert judge_file(file, keys).trusted
    assert {judge_file(flipped(file, bit), keys).outcome for bit in range(8 * len(file))} == {"SUFFIX"}
    image, suffix = file[:-16], Suffix(0x1209, 0x0001, 0x0100)
    outcomes = [judge_file(with_suffix(flipped(image, bit), suffix), keys).outcome for bit in range(8 * len(image))]
    assert "SIGNED" not in outcomes
    assert set(outcomes[-512:]) == {"SIGNATURE"}
    assert set(outcomes[8 * 16 : 8 * 24]) == {"CHECKSUM"}  # the key's number
