import laspy
import numpy as np
import pytest
import random_records
from pypcd4 import Encoding, PointCloud

from ellipseg_ros.errors import InputError
from ellipseg_ros.io.cloud_file import CloudSweeps, read_fields
from ellipseg_ros.io.formats import FORMATS, npz, ply
from ellipseg_ros.io.pointcloud2 import labelled_fields, read_sweep, write_sweep

N = 30
UTM = np.array([456_789.0, 5_400_000.0, 312.0])


def points():
    """(N, 3) on a grid of 2^-10 m, far from zero."""
    return UTM + np.random.default_rng(0).integers(-(2**15), 2**15, (N, 3)) / 1024


def column(name, kind):
    return np.random.default_rng(1).integers(0, 120, N).astype(kind), name


def fields():
    table = np.zeros(
        N,
        [("x", "f8"), ("y", "f8"), ("z", "f8"), ("intensity", "f4"), ("ring", "u2"), ("id", "u4")],
    )
    for name, values in zip("xyz", points().T, strict=True):
        table[name] = values
    rng = np.random.default_rng(1)
    table["intensity"] = rng.normal(size=N).astype(np.float32)
    table["ring"] = rng.integers(0, 2**16, N)
    table["id"] = rng.integers(0, 2**32, N)
    return table


def one_sweep(path):
    source = CloudSweeps(path)
    (sweep,) = source
    (again,) = source
    assert source.count == 1 and source.duration == 0.0 and sweep.frame_id == source.frame_id
    assert sweep.stamp_ns == 0 and not sweep.offsets_ns.any()
    np.testing.assert_array_equal(sweep.points, again.points)
    assert sweep.fields.tobytes() == again.fields.tobytes()
    return sweep


def refused(path, reason):
    with pytest.raises(InputError) as error:
        list(CloudSweeps(path))
    assert error.value.reason == reason
    assert len(str(error.value).splitlines()) == 1
    assert path.name in str(error.value)
    return str(error.value)


# --- PCD -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("encoding", [Encoding.ASCII, Encoding.BINARY, Encoding.BINARY_COMPRESSED])
def test_pcd_in_every_encoding(tmp_path, encoding):
    table = fields()
    columns = [table[name] for name in table.dtype.names]
    cloud = PointCloud.from_points(columns, table.dtype.names, [c.dtype for c in columns])
    cloud.save(tmp_path / "cloud.pcd", encoding=encoding)
    sweep = one_sweep(tmp_path / "cloud.pcd")
    np.testing.assert_array_equal(sweep.points, points())
    for name in ("ring", "id"):
        np.testing.assert_array_equal(sweep.fields[name], table[name])
        assert sweep.fields.dtype[name] == table.dtype[name]
    np.testing.assert_allclose(sweep.fields["intensity"], table["intensity"], rtol=1e-6)


def test_pcd_with_counts_padding_nan_and_organised(tmp_path):
    header = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS z _ normal x y\nSIZE 4 1 4 4 4\nTYPE F U F F F\n"
        "COUNT 1 4 3 1 1\nWIDTH 2\nHEIGHT 2\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\nDATA binary\n"
    )
    kinds = [("z", "f4"), ("gap", "u1", 4), ("normal", "f4", 3), ("x", "f4"), ("y", "f4")]
    table = np.zeros(4, kinds)
    table["x"], table["y"], table["z"] = np.arange(12).reshape(3, 4)
    table["normal"] = np.arange(12).reshape(4, 3)
    table["x"][1] = np.nan
    (tmp_path / "cloud.pcd").write_bytes(header.encode() + table.tobytes())
    sweep = one_sweep(tmp_path / "cloud.pcd")
    assert sweep.fields.dtype.names == ("z", "normal", "x", "y")
    for name in ("x", "y", "z", "normal"):
        np.testing.assert_array_equal(sweep.fields[name], table[name])


def test_pcd_of_one_point_in_ascii(tmp_path):
    text = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
    text += "WIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n"
    (tmp_path / "one.pcd").write_text(text + "1 2 nan\n")
    np.testing.assert_array_equal(one_sweep(tmp_path / "one.pcd").points, [[1.0, 2.0, np.nan]])


# --- PLY -----------------------------------------------------------------------------------------

PLY_TYPES = {"f8": "double", "f4": "float", "u2": "ushort", "u4": "uint32"}


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_in_every_format_with_faces_behind(tmp_path, kind):
    table = fields()
    names = table.dtype.names
    header = ["ply", f"format {kind} 1.0", "comment made by hand", f"element vertex {N}"]
    header += [f"property {PLY_TYPES[table.dtype[n].str[1:]]} {n}" for n in names]
    header += ["element face 1", "property list uchar int vertex_indices", "end_header", ""]
    if kind == "ascii":
        rows = [" ".join(repr(value.item()) for value in row) for row in table]
        body = "\n".join([*rows, "3 0 1 2", ""]).encode()
    else:
        order = "<" if "little" in kind else ">"
        face = np.array([(3, (0, 1, 2))], [("n", "u1"), ("rows", order + "i4", 3)])
        body = table.astype(table.dtype.newbyteorder(order)).tobytes() + face.tobytes()
    (tmp_path / "cloud.ply").write_bytes("\n".join(header).encode() + body)
    sweep = one_sweep(tmp_path / "cloud.ply")
    np.testing.assert_array_equal(sweep.points, points())
    for name in names:
        np.testing.assert_array_equal(sweep.fields[name], table[name])
        assert sweep.fields.dtype[name] == table.dtype[name]


# --- LAS -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".las", ".laz", ".LAZ"])
def test_las_and_laz(tmp_path, suffix):
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [1 / 1024] * 3, np.floor(UTM)
    header.add_extra_dim(laspy.ExtraBytesParams("reflectance", "f4"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points().T
    table = fields()
    las.intensity, las.gps_time = table["ring"], np.arange(N) * 1000.0
    las.reflectance = table["intensity"]
    las.write(str(tmp_path / f"cloud{suffix}"), do_compress=suffix != ".las")
    sweep = one_sweep(tmp_path / f"cloud{suffix}")
    np.testing.assert_array_equal(sweep.points, points())
    np.testing.assert_array_equal(sweep.fields["intensity"], table["ring"])
    np.testing.assert_array_equal(sweep.fields["reflectance"], table["intensity"])
    np.testing.assert_array_equal(sweep.fields["gps_time"], np.arange(N) * 1000.0)
    assert {"classification", "return_number"} <= set(sweep.fields.dtype.names)


# --- NPZ -----------------------------------------------------------------------------------------


def test_npz_with_times_and_sweeps_is_a_drive(tmp_path):
    sweep = np.repeat([7, 5, 9], 10)  # stored in another order than driven
    t = sweep * 0.5 + np.tile(np.arange(10), 3)[::-1] * 0.01
    np.savez(
        tmp_path / "drive.npz", xyz=points(), t=t, sweep=sweep, label=np.arange(N), poses=np.eye(4)
    )
    source = CloudSweeps(tmp_path / "drive.npz")
    found = list(source)
    assert source.count == 3 and source.duration == pytest.approx(np.ptp(t))
    assert [s.stamp_ns for s in found] == [2_500_000_000, 3_500_000_000, 4_500_000_000]
    for s, number in zip(found, (5, 7, 9), strict=True):
        mine = sweep == number
        np.testing.assert_array_equal(s.points, points()[mine])
        np.testing.assert_array_equal(s.times_ns, np.rint(t[mine] * 1e9))
        np.testing.assert_array_equal(s.fields["label"], np.arange(N)[mine])
        assert s.fields.dtype.names == ("x", "y", "z", "t", "sweep", "label")


def test_npz_with_times_only_is_cut_into_tenths_of_a_second(tmp_path):
    t = np.linspace(10.0, 10.99, N)
    np.savez(tmp_path / "drive.npz", xyz=points(), t=t)
    found = list(CloudSweeps(tmp_path / "drive.npz"))
    assert len(found) == 10 and sum(map(len, found)) == N
    assert all(0 <= s.offsets_ns.min() and s.offsets_ns.max() < 10**8 for s in found)
    np.testing.assert_array_equal(np.concatenate([s.times_ns for s in found]), np.rint(t * 1e9))


def test_npz_without_times_is_one_sweep(tmp_path):
    x, y, z = points().T
    np.savez(tmp_path / "cloud.npz", x=x, y=y, z=z, normal=np.zeros((N, 3), np.float32))
    sweep = one_sweep(tmp_path / "cloud.npz")
    np.testing.assert_array_equal(sweep.points, points())
    assert sweep.fields.dtype["normal"].shape == (3,)


@pytest.mark.parametrize(
    ("reason", "arrays"),
    [
        ("no_xyz", {"depth": np.zeros(3)}),
        ("no_xyz", {}),
        ("shape", {"xyz": np.zeros((3, 2))}),
        ("shape", {"xyz": np.zeros(3)}),
        ("xyz_type", {"xyz": np.zeros((3, 3), int)}),
        ("bad_input", {"xyz": np.array([["a", "b", "c"]])}),
        ("bad_cloud", {"xyz": np.zeros((1, 3), object)}),
        ("bad_cloud", {"x": np.zeros(2), "y": np.zeros(3), "z": np.zeros(2)}),
        ("empty", {"xyz": np.zeros((0, 3))}),
        ("times", {"xyz": np.zeros((2, 3)), "t": np.array([0.0, np.nan])}),
    ],
)
def test_npz_without_valid_points_is_refused(tmp_path, reason, arrays):
    np.savez(tmp_path / "bad.npz", **arrays)
    refused(tmp_path / "bad.npz", reason)


def test_recorded_scenes_survive_a_round_trip_as_messages(shared_data):
    deserialize = message_reader()
    scenes = [path for path in sorted(shared_data.glob("*.npz")) if is_labelled_drive(path)]
    assert len(scenes) >= 8
    for path in scenes:
        source = CloudSweeps(path)
        with np.load(path) as file:
            count, numbers = len(file["xyz"]), file["sweep"]
        found = list(source)
        assert sum(map(len, found)) == count
        assert source.count == len(found) == len(np.unique(numbers))
        assert all(a.stamp_ns < b.stamp_ns for a, b in zip(found[:-1], found[1:], strict=True))
        for sweep in found[:: max(1, len(found) // 3)]:
            assert np.ptp(sweep.fields["sweep"]) == 0
            assert np.abs(sweep.times_ns - sweep.fields["t"] * 1e9).max() <= 1
            back = read_sweep(deserialize(write_sweep(sweep)))
            np.testing.assert_array_equal(back.points, sweep.points)
            np.testing.assert_array_equal(back.offsets_ns, sweep.offsets_ns)


def is_labelled_drive(path):
    """Whether an archive holds a drive: others hold poses, stems and landmarks."""
    with np.load(path) as file:
        return {"xyz", "t", "sweep"} <= set(file.files)


def message_reader():
    from ellipseg_ros.io.bag import node_types
    from ellipseg_ros.io.topics import CLOUD

    return lambda raw: node_types().deserialize_cdr(raw, CLOUD)


# --- bad files -----------------------------------------------------------------------------------


def good_file(path):
    """One file of each kind."""
    if path.suffix == ".pcd":
        PointCloud.from_xyz_points(points().astype(np.float32)).save(path)
    elif path.suffix in (".las", ".laz"):
        las = laspy.LasData(laspy.LasHeader(point_format=3))
        las.x, las.y, las.z = points().T - UTM[:, None]
        las.write(str(path))
    elif path.suffix == ".ply":
        ply.write(path, random_records.segmentation())
    else:
        npz.write(path, random_records.segmentation())
    return path.read_bytes()


@pytest.mark.parametrize("suffix", sorted(FORMATS))
def test_truncated_or_wrong_file_is_refused_in_one_line(tmp_path, suffix):
    path = tmp_path / f"cloud{suffix}"
    whole = good_file(path)
    assert len(read_fields(path))
    for part in (b"", whole[:7], whole[: len(whole) // 2], whole[:-30], b"hello\n" * 100):
        path.write_bytes(part)
        refused(path, "bad_cloud")


# Not LAS and LAZ: laspy and lazrs believe any count in a header, and take the memory for it.
@pytest.mark.parametrize("suffix", [".npz", ".pcd", ".ply"])
def test_damaged_file_is_refused_in_one_line(tmp_path, suffix):
    path = tmp_path / f"cloud{suffix}"
    whole = good_file(path)
    rng = np.random.default_rng(0)
    refusals = []
    for _ in range(30):
        damaged = bytearray(whole)
        start = rng.integers(min(len(whole), 400))
        damaged[start : start + 20] = rng.bytes(20)
        path.write_bytes(damaged)
        try:
            list(CloudSweeps(path))
        except InputError as error:
            refusals.append(str(error))
    assert refusals and all(len(text.splitlines()) == 1 for text in refusals)


def test_unknown_suffix_is_refused_with_a_list_of_formats(tmp_path):
    (tmp_path / "cloud.e57").touch()
    assert ".pcd, .ply, .las, .laz, .npz" in refused(tmp_path / "cloud.e57", "suffix")


# --- writing -------------------------------------------------------------------------------------


def found_with(table):
    return random_records.segmentation(len(table), 5, fields=table)


def test_written_npz_is_complete_and_can_be_read_as_a_drive(tmp_path):
    found = found_with(fields())
    npz.write(tmp_path / "out.npz", found)
    with np.load(tmp_path / "out.npz") as file:
        np.testing.assert_array_equal(file["xyz"], points())
        np.testing.assert_array_equal(file["label"], found.point_ids)
        np.testing.assert_array_equal(file["segment_id"], found.ids)
        np.testing.assert_array_equal(file["segment_mean"], found.ellipsoids.mean)
        np.testing.assert_allclose(file["t"], found.times_ns / 1e9, rtol=1e-15)
        np.testing.assert_array_equal(file["id"], fields()["id"])
    assert sum(map(len, CloudSweeps(tmp_path / "out.npz"))) == N
    assert [p.name for p in tmp_path.iterdir()] == ["out.npz"]


def test_written_ply_holds_every_point_field_label_and_colour(tmp_path):
    table = np.zeros(
        N, fields().dtype.descr + [("normal", "f4", (3,)), ("odd name", "i8"), ("ok", "?")]
    )
    for name in fields().dtype.names:
        table[name] = fields()[name]
    table["normal"] = np.arange(3 * N).reshape(N, 3)
    found = found_with(table)
    ply.write(tmp_path / "out.ply", found)
    sweep = one_sweep(tmp_path / "out.ply")
    np.testing.assert_array_equal(sweep.points, points())
    for name in fields().dtype.names:
        np.testing.assert_array_equal(sweep.fields[name], table[name])
    np.testing.assert_array_equal(sweep.fields["label"], found.point_ids)
    np.testing.assert_array_equal(sweep.fields["normal_2"], table["normal"][:, 2])
    packed = np.ascontiguousarray(labelled_fields(found)["rgb"]).view(np.uint32)
    rgb = [sweep.fields[name].astype(np.uint32) for name in ("red", "green", "blue")]
    np.testing.assert_array_equal(rgb[0] << 16 | rgb[1] << 8 | rgb[2], packed)
    assert {"odd_name", "ok"} <= set(sweep.fields.dtype.names)


@pytest.mark.parametrize("write", [npz.write, ply.write])
def test_failed_write_leaves_existing_files_unchanged(tmp_path, write):
    with pytest.raises(InputError) as error:
        write(tmp_path / "no folder" / "out.npz", random_records.segmentation())
    assert error.value.reason == "write" and len(str(error.value).splitlines()) == 1
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError):
        write(tmp_path / "out", random_records.segmentation())
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
