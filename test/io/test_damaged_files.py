"""Spoiled files: one clear line and exit code 2, or results as if nothing were wrong."""

import shutil
import struct
import zipfile
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from crashing_worker import crashing_worker

from ellipseg_ros.cli.main import main
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.cloud_file import read_fields
from ellipseg_ros.io.formats import npz, ply
from ellipseg_ros.io.sources import open_source
from ellipseg_ros.segmenter import segment
from studies.endurance import file_trials
from studies.endurance.damage import DAMAGES, damage
from studies.endurance.file_trials import (
    INTACT,
    SKIPPED,
    Outcome,
    Worker,
    answer,
    task_for,
    try_files,
)
from studies.endurance.files import file_requirements
from studies.endurance.samples import POINTS, WRITERS, write_samples


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    return write_samples(tmp_path_factory.mktemp("samples") / "good")


def copied(samples, kind, folder):
    """A copy of a sample that may be spoiled."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(samples[kind].parent, folder)
    return folder / samples[kind].name


@pytest.mark.parametrize("kind", WRITERS)
def test_damaged_files_of_every_format_give_one_line(samples, tmp_path, kind):
    def tried(folder):
        return Outcome(kind, "", **answer(task_for(kind, folder, samples)))

    copied(samples, kind, tmp_path / "whole")
    outcome = tried(tmp_path / "whole")
    assert (outcome.code, outcome.fault) == (0, "")
    codes = set()
    for case in range(12):
        path = copied(samples, kind, tmp_path / "spoiled")
        how = damage(path, samples["parameters"], 11, case)
        outcome = tried(tmp_path / "spoiled")
        assert not outcome.fault, (how, outcome.line)
        codes.add(outcome.code)
    assert 2 in codes


def test_every_damage_changes_something(samples, tmp_path):
    for name, spoil in DAMAGES.items():
        changed = 0
        for seed in range(5):
            path = copied(samples, "pcd ascii", tmp_path / "spoiled")
            spoil(path, samples["las"], np.random.default_rng(seed))
            there = path.is_file() and path.stat().st_mode & 0o400
            changed += not there or path.read_bytes() != samples["pcd ascii"].read_bytes()
        assert changed >= 4, name


# --- the process that reads them, and the verdict -----------------------------------------------


def test_dead_or_hanging_process_is_a_fault_and_replaced():
    with Worker(crashing_worker, timeout_s=1.0) as worker:
        assert worker.run({"kind": "dies"}, "las", "cut").fault == "the process ended with 7"
        assert "no answer within 1 s" in worker.run({"kind": "hangs"}, "las", "cut").fault
        assert worker.run({"kind": "good"}, "las", "cut").code == 2


@pytest.mark.parametrize(
    ("wrong", "fault"),
    [
        (lambda task: 1, "exit code 1"),
        (lambda task: print("ellipseg: one\nmore") or 2, "not one clear line"),
        (lambda task: 2, "not one clear line"),
        (lambda task: 1 // 0, "ZeroDivisionError"),
        (lambda task: np.ones(10_000_000).sum() and 0, "it took"),
    ],
)
def test_wrong_outcome_is_a_fault(tmp_path, wrong, fault):
    task = {"kind": "las", "path": str(tmp_path / "cloud.las"), "cloud": ""}
    result = answer(task, lambda task, out: wrong(task), max_memory_mb=50.0)
    assert fault in result["fault"]


@pytest.mark.parametrize(("user", "how"), [(0, SKIPPED), (1000, "locked")])
def test_locked_file_is_skipped_for_root(monkeypatch, user, how):
    tried = []
    fake = SimpleNamespace(run=lambda task, kind, how: tried.append(how) or refused_as(how))
    monkeypatch.setattr(file_trials, "Worker", lambda: nullcontext(fake))
    monkeypatch.setattr(file_trials, "damage", lambda *_: "locked")
    monkeypatch.setattr(file_trials.os, "geteuid", lambda: user)
    found = [one.damage for one in try_files(0, 1)]
    assert found == [INTACT] * len(WRITERS) + [how] * len(WRITERS)
    assert ("locked" in tried) == (user != 0)


def refused_as(how):
    return Outcome("las", how, 2, "ellipseg: no", 0.1, 1.0, "")


def test_partial_results_are_a_fault(tmp_path):
    def half(task, out):
        (out / ".bag.part").mkdir(parents=True)
        return 0

    task = {"kind": "las", "path": str(tmp_path / "cloud.las"), "cloud": ""}
    assert "left behind: .bag.part" in answer(task, half)["fault"]


def test_single_fault_breaks_the_requirement():
    whole = Outcome("las", INTACT, 0, "", 0.1, 1.0, "")
    refused = Outcome("las", "cut", 2, "ellipseg: no", 0.1, 1.0, "")
    assert all(row.met for row in file_requirements([whole, refused]))
    for bad in (
        Outcome("las", "cut", -1, "", 0.1, 1.0, "Traceback"),
        Outcome("las", INTACT, 2, "ellipseg: no", 0.1, 1.0, ""),
    ):
        assert not file_requirements([whole, refused, bad])[0].met
    skipped = Outcome("las", SKIPPED, -1, "", 0.0, 0.0, "")
    row = file_requirements([whole, refused, skipped])[0]
    assert (
        row.met and row.test.startswith("1 files") and "1 more without read permission" in row.test
    )
    slow = Outcome("las", "cut", 2, "ellipseg: no", 100.0, 1.0, "")
    assert not file_requirements([whole, slow])[1].met


# --- headers with wrong claims ------------------------------------------------------------------


def refused(path):
    with pytest.raises(InputError) as error:
        read_fields(path)
    assert len(str(error.value).splitlines()) == 1
    return str(error.value)


@pytest.mark.parametrize("kind", ["pcd ascii", "pcd binary", "pcd compressed"])
def test_pcd_that_claims_billions_of_points_is_refused(samples, tmp_path, kind):
    path = copied(samples, kind, tmp_path / "spoiled")
    data = path.read_bytes()
    path.write_bytes(data.replace(b"POINTS %d" % POINTS, b"POINTS 4000000000"))
    assert "claims 4000000000 points" in refused(path)
    path.write_bytes(data.replace(b"COUNT 1", b"COUNT 1000000000"))
    assert "values per point" in refused(path)


@pytest.mark.parametrize("kind", ["ply ascii", "ply binary"])
def test_ply_that_claims_billions_of_points_is_refused(samples, tmp_path, kind):
    path = copied(samples, kind, tmp_path / "spoiled")
    data = path.read_bytes()
    path.write_bytes(data.replace(b"vertex %d" % POINTS, b"vertex 4000000000"))
    assert "claims 4000000000 points" in refused(path)
    path.write_bytes(data.replace(b"end_header", b"and_header"))
    assert "no end" in refused(path)


@pytest.mark.parametrize(
    ("kind", "place", "code", "claim", "what"),
    [
        ("las", 247, "<Q", 2**40, "points"),
        ("las", 96, "<I", 2**31, "bytes before the points"),
        ("las", 100, "<I", 2**32 - 1, "records"),
        ("laz", 100, "<I", 2**32 - 1, "records"),
    ],
)
def test_las_that_claims_more_than_its_size_is_refused(
    samples, tmp_path, kind, place, code, claim, what
):
    path = copied(samples, kind, tmp_path / "spoiled")
    data = bytearray(path.read_bytes())
    struct.pack_into(code, data, place, claim)
    path.write_bytes(bytes(data))
    assert f"claims {claim} {what}" in refused(path)


def test_laz_that_claims_billions_of_chunks_is_refused(samples, tmp_path):
    path = copied(samples, "laz", tmp_path / "spoiled")
    data = bytearray(path.read_bytes())
    (start,) = struct.unpack_from("<I", data, 96)
    (table,) = struct.unpack_from("<q", data, start)
    struct.pack_into("<I", data, table + 4, 2**32 - 1)
    path.write_bytes(bytes(data))
    assert "claims 4294967295 chunks" in refused(path)


def test_laz_that_claims_more_points_than_it_has_is_refused_after_one_chunk(samples, tmp_path):
    path = copied(samples, "laz", tmp_path / "spoiled")
    data = bytearray(path.read_bytes())
    struct.pack_into("<Q", data, 247, 2**40)
    path.write_bytes(bytes(data))
    outcome = answer({"kind": "laz", "path": str(path), "cloud": ""})
    assert (outcome["code"], outcome["fault"]) == (2, "")


def test_array_with_a_wrong_size_is_refused(tmp_path):
    path = tmp_path / "cloud.npz"
    np.savez(path, xyz=np.zeros((300, 3)))
    path.write_bytes(path.read_bytes().replace(b"(300, 3)", b"(9e9, 3)"))
    refused(path)
    head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (3000000000, 3), }".ljust(117)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("xyz.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", 118) + head + b"\n")
    assert "another size than it says" in refused(path)


def test_arrays_that_unpack_to_too_many_bytes_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(npz, "MAX_UNPACKED_BYTES", 1000)
    np.savez_compressed(tmp_path / "cloud.npz", xyz=np.zeros((300, 3)))
    assert "unpacks to" in refused(tmp_path / "cloud.npz")


def test_invalid_times_are_refused(tmp_path):
    np.savez(tmp_path / "cloud.npz", xyz=np.zeros((3, 3)), t=np.array([0.0, 1e300, 1.0]))
    with pytest.raises(InputError, match="t holds"):
        open_source(tmp_path / "cloud.npz")


# --- names of fields ----------------------------------------------------------------------------


def test_fields_may_have_any_name_of_a_message_field(tmp_path):
    names = ["file", "allow_pickle", "args", "a", "a_0", "a b", "a_b"]
    kinds = [("x", "f4"), ("y", "f4"), ("z", "f4"), *((n, "f4") for n in names if n != "a")]
    path = tmp_path / "cloud.npz"
    table = np.zeros(40, [*kinds, ("a", "f4", (2,))])
    rng = np.random.default_rng(0)
    for name in table.dtype.names:
        table[name] = rng.uniform(0.0, 1.0, table[name].shape)
    found = segment(np.column_stack([table[n] for n in "xyz"]))
    object.__setattr__(found, "fields", table)
    npz.write(path, found)
    again = read_fields(path)
    for name in names:
        np.testing.assert_array_equal(again[name], table[name])
    ply.write(tmp_path / "cloud.ply", found)
    written = read_fields(tmp_path / "cloud.ply")
    values = {tuple(written[n]) for n in written.dtype.names if n.startswith("a")}
    assert len(values) == 7  # allow_pickle, args, a b and a_b, a_0, and two of a


def test_unreadable_parameter_file_is_one_line(tmp_path, capsys):
    assert main(["segment", "sim:woodland", "--params", str(tmp_path), "-q"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
