"""Numbers of text tables: the float64 nearest to what is written, however it is written."""

import bz2
import csv
import gzip
import io

import numpy as np
import pytest
from backports import zstd

HEADER = ["timestamp_ns", "ax", "ay", "az", "gx", "gy", "gz"]
# halfway between two float64, and a little beside; longer than any float64; the ends of their range
AWKWARD = """
    1.00000000000000011102230246251565404236316680908203125
    1.00000000000000011102230246251565404236316680908203124
    1.00000000000000033306690738754696212708950042724609375
    9007199254740993 9007199254740992.99999999999999999999999
    0.1000000000000000055511151231257827021181583404541015625
    123456789012345678901234567890.123456789012345678901234567890
    2.2250738585072011e-308 4.9406564584124654e-324 1.7976931348623157e308 1e-400
    -0.000000000000000000000000000000000000000000000000000000000001 0.3e-1 +7 .5 5. 1E+2
""".split()


def nearest(texts):
    return np.array([[float(text) for text in row] for row in texts])


def written(stamps, texts, **dialect):
    file = io.StringIO(newline="")
    writer = csv.writer(file, **dialect)
    writer.writerow(HEADER)
    writer.writerows([[stamp, *row] for stamp, row in zip(stamps.tolist(), texts, strict=True)])
    return file.getvalue().encode()


@pytest.mark.parametrize("digits", ["{!r}", "{:.9E}", "{:.40f}"])
@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
def test_every_bit(hard, hard_stamps, every_bit, tmp_path, separator, digits):
    texts = [[digits.format(x) for x in row] for row in hard.tolist()]
    (tmp_path / "log.csv").write_bytes(written(hard_stamps, texts, delimiter=separator))
    every_bit(tmp_path / "log.csv", nearest(texts), hard_stamps)


@pytest.mark.parametrize("separator", [";", "\t", " "])
def test_every_bit_of_decimal_commas(hard, hard_stamps, every_bit, tmp_path, separator):
    texts = [[repr(x) for x in row] for row in hard.tolist()]
    commas = [[text.replace(".", ",") for text in row] for row in texts]
    (tmp_path / "log.csv").write_bytes(written(hard_stamps, commas, delimiter=separator))
    every_bit(tmp_path / "log.csv", hard, hard_stamps)


@pytest.mark.parametrize("pack", [gzip, bz2, zstd], ids=lambda module: module.__name__)
def test_every_bit_of_packed_text(hard, hard_stamps, every_bit, tmp_path, pack):
    path = tmp_path / f"log.csv.{ {'gzip': 'gz', 'bz2': 'bz2'}.get(pack.__name__, 'zst') }"
    path.write_bytes(pack.compress(written(hard_stamps, hard.tolist())))
    every_bit(path, hard, hard_stamps)


@pytest.mark.parametrize(
    ("separator", "quoting"),
    [(",", csv.QUOTE_MINIMAL), (" ", csv.QUOTE_MINIMAL), (",", csv.QUOTE_ALL)],
)
def test_every_bit_of_awkward_numbers(hard_stamps, every_bit, tmp_path, separator, quoting):
    texts = [AWKWARD[i % len(AWKWARD) :][:6] for i in range(300)]
    texts = [(row + AWKWARD)[:6] for row in texts]
    content = written(hard_stamps, texts, delimiter=separator, quoting=quoting)
    (tmp_path / "log.csv").write_bytes(content)
    every_bit(tmp_path / "log.csv", nearest(texts), hard_stamps)


def test_every_bit_of_decimal_stamps(hard, every_bit, tmp_path):
    stamps = 1_700_000_000 + np.cumsum(np.random.default_rng(2).uniform(0.009, 0.011, 300))
    content = written(stamps, hard.tolist()).replace(b"timestamp_ns", b"timestamp_s")
    (tmp_path / "log.csv").write_bytes(content)
    every_bit(tmp_path / "log.csv", hard, stamps)
