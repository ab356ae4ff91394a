"""Bytes changed here and there, whatever they mean."""

import re

# what breaks numbers, texts, tables and paths
TOKENS = "nan inf -inf 1e999 -0 0x10 1_000 9223372036854775808 1e-320 é \ufeff , ; ,,,, # ' \\ {{"
TOKENS += " 2024-13-45T99:00 2024-01-01T00:00:00Z ../../x /etc/passwd <script> %PDF t ax ax.x"
TOKENS = [*TOKENS.split(), "", " ", "\t", "\r", "\n", "\0", '"']


def mutate(rng, content, text, seeds):
    """Return bytes with a few changes."""
    data = bytearray(content)
    for _ in range(rng.choice([1, 1, 1, 2, 3, 5, 20])):
        at, size = rng.randrange(len(data) + 1), int(2 ** rng.uniform(0, 9))
        way = rng.randrange(9 if text else 7)
        if way == 0:
            data[at : at + size] = rng.randbytes(size)
        elif way == 1:
            del data[at : at + size]
        elif way == 2:
            begin = rng.randrange(len(data) + 1)
            data[at:at] = data[begin : begin + size] * rng.choice([1, 1, 2, 300])
        elif way == 3 and data:
            data[at % len(data)] ^= 1 << rng.randrange(8)
        elif way == 4:
            extreme(rng, data, at)
        elif way == 5:
            del data[rng.randrange(len(data) + 1) :]
        elif way == 6:
            _, other = rng.choice(seeds)
            data[at:] = other[rng.randrange(len(other)) :]
        elif way == 7:
            data[at : at + rng.randrange(4)] = rng.choice(TOKENS).encode("utf-8")
        else:
            lines = bytes(data).split(b"\n")
            token = rng.choice(TOKENS).encode("utf-8")
            row = rng.randrange(len(lines))
            fields = re.split(rb"([,;\t ])", lines[row])
            fields[2 * rng.randrange(len(fields) // 2 + 1)] = token
            lines[row] = b"".join(fields)
            if rng.random() < 0.3:
                rng.shuffle(lines)
            data = bytearray(b"\n".join(lines))
    return bytes(data)


def extreme(rng, data, at):
    """Write a number that is at a limit, or one off what was there."""
    width, order = rng.choice([1, 2, 4, 8]), rng.choice(["little", "big"])
    there = int.from_bytes(data[at : at + width], order)
    limits = [0, 1, -1, 127, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**62]
    number = rng.choice([*limits, there + 1, there - 1, 2 * there])
    data[at : at + width] = (number % 256**width).to_bytes(width, order)
