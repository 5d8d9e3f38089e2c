"""Reads a series of values from a CSV file, or from a topic of another run's log."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from bus.messages import Message
from orchestrator.errors import InputError
from orchestrator.log.reader import read_log

Rows = list[list[float]]


class SeriesError(InputError):
    """A series cannot be read; the text names the file, the line, and the cure."""


def read_series(place: str) -> Rows:
    """Return the rows of a series, all of one length.

    Parameters
    ----------
    place
        The path of a CSV file, with or without a header, a row a line; or ``run.mcap#topic:field``, such as
        ``run.mcap#truth/plant:state``: the field's value in each message of the topic, in their order.

    Raises
    ------
    SeriesError
        When there is no such file, topic or field, a value is not a finite number, or rows differ in length.
    LogError
        When the log is damaged or none of ours.
    """
    path, mark, address = place.partition("#")
    return _of_log(Path(path), address) if mark else _of_csv(Path(path))


def _of_csv(path: Path) -> Rows:
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.reader(stream)
            lines = [(reader.line_num, cells) for cells in reader if any(cell.strip() for cell in cells)]
    except OSError as error:
        raise SeriesError(f"{path} cannot be read: {error.strerror}; check its name and rights") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise SeriesError(f"{path} is no CSV text: {error}") from error
    if lines and all(_number(cell) is None for cell in lines[0][1]):
        del lines[0]  # its header
    return _checked(str(path), [(f"{path}:{number}", cells) for number, cells in lines])


def _of_log(path: Path, address: str) -> Rows:
    topic, _, field = address.rpartition(":")
    if not topic or not field:
        raise SeriesError(f"'{path}#{address}' names no field; write for example {path}#truth/plant:state")
    log = read_log(path)
    rows = []
    topics = set()
    for name, message in log.records():
        topics.add(name)
        if name == topic:
            rows.append((f"{path}#{topic} at step {message.step}", _field(path, topic, message, field)))
    if topic not in topics:
        raise SeriesError(f"{path} has no topic '{topic}'; it has {', '.join(sorted(topics)) or 'none'}")
    return _checked(f"{path}#{address}", rows)


def _field(path: Path, topic: str, message: Message, field: str) -> list[str]:
    names = message.__struct_fields__
    if field not in names:
        raise SeriesError(f"{path}#{topic} has no field '{field}'; it has {', '.join(names)}")
    value = getattr(message, field)
    return [str(one) for one in (value if isinstance(value, list) else [value])]


def _checked(place: str, rows: list[tuple[str, list[str]]]) -> Rows:
    if not rows:
        raise SeriesError(f"{place} holds no row; give at least one")
    width = len(rows[0][1])
    series = []
    for where, cells in rows:
        if len(cells) != width or not cells:
            raise SeriesError(f"{where} has {len(cells)} values, the first row {width}; give all one length")
        numbers = []
        for cell in cells:
            number = _number(cell)
            if number is None or not math.isfinite(number):
                raise SeriesError(f"{where}: '{cell.strip()}' is not a finite number")
            numbers.append(number)
        series.append(numbers)
    return series


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
