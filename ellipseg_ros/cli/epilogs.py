"""What `ellipseg --help` and `ellipseg COMMAND --help` end with: examples."""

EXAMPLES = """examples:
  ellipseg segment drive.mcap               segment a bag; writes drive_segmented/
  ellipseg segment sim:woodland -o wood     the same of a simulated scene
  ellipseg simulate industrial -o yard      write a simulated drive as a bag
  ellipseg tune drive.mcap                  find the threshold for a recording
  ellipseg replay yard --rate 2             publish a bag for a node that runs
  ellipseg demo                             node, replay and check, in one go
  ellipseg bench --quick                    how fast it is on this machine
  ellipseg soak --quick                     how much it stands
  ellipseg doctor                           what is wrong here, and what to do
  ellipseg evaluate partition sim:mixed     how good the segments are, beside other methods
`ellipseg COMMAND --help` tells more."""

SIMULATE = """example:
  ellipseg simulate woodland -o wood --duration 10 --seed 3
  ellipseg simulate woodland -o back --duration 10 --seed 3 --noise-seed 1 --start 30 --backwards
  ellipseg segment wood -o wood_segmented"""

SEGMENT = """examples:
  ellipseg segment drive.mcap -o out --topic /velodyne/registered
  ellipseg segment cloud.ply --criterion parsimony
  ellipseg segment sim:roadway --threshold 12 --set graph.neighbours=15
  ellipseg segment drive.mcap --params config/segmenter.yaml --json > summary.json"""

TUNE = """examples:
  ellipseg tune drive.mcap                           windows of 25 s, end to end
  ellipseg tune sim:woodland --criterion all -o wood_tuned
  ellipseg tune monday.mcap tuesday.mcap --every 10 --jobs 4
  ellipseg tune drive.mcap --scheduler tcp://10.0.0.1:8786
It ends with a parameter file: ros2 run ellipseg_ros segmenter --ros-args --params-file FILE"""

REPLAY = """examples:
  ellipseg replay drive.mcap --topic /velodyne/registered --rate 0.5
  ellipseg replay sim:industrial --loop
  ellipseg replay drive.mcap --rate 0 --ahead 2     as fast as the node segments, losing nothing"""

PAPER = """examples:
  ellipseg paper -o paper
  ellipseg paper monday.mcap tuesday.mcap --set max_points_per_second=15000 -o paper"""

DEMO = """examples:
  ellipseg demo
  ellipseg demo --data drive.mcap --topic /velodyne/registered -o drive_demo"""

BENCH = """examples:
  ellipseg bench                            all of it, ten to twenty minutes
  ellipseg bench --quick --only batch peers
  ellipseg bench -o docs                    write docs/benchmarks.md, .json and .png"""

SOAK = """examples:
  ellipseg soak                             all of it, an hour and a quarter
  ellipseg soak hour overload --quick
  ellipseg soak -o docs                     write docs/reliability.md and .json

Exit code 1: a promise was not kept. With -o, earlier results of other subjects are kept."""

DOCTOR = """examples:
  ellipseg doctor                           installation, environment, running graph
  ellipseg doctor --topic /cloud_registered --seconds 10
  ellipseg doctor --namespace /front
  ellipseg doctor --offline --json

Exit code 1: something is an error. --quiet prints errors alone."""

EVALUATE = """examples:
  ellipseg evaluate partition scan.npz      how well segments keep classes and things apart
  ellipseg evaluate scale drive.mcap        where to cut objects, and what depends on it
  ellipseg evaluate association             what of one drive is found again in another"""

ASSOCIATION = """examples:
  ellipseg evaluate association --seeds 2 --others 0
  ellipseg evaluate association -o docs     write docs/association.md, .json and .png"""

PARTITION = """examples:
  ellipseg evaluate partition sim:roadway --methods objects cut-pursuit
  ellipseg evaluate partition scan_1.npz scan_2.npz sim:woodland -o docs
  ellipseg evaluate partition scan_3.npz --add-to docs/quality.json -o docs

A scan is any source whose points have a class: a field `class` or `coarse` of 1 ground,
2 vegetation, 3 trunk or pole, 4 wire, 5 wall or fence, 6 vehicle, 7 person, 8 other, 0 unknown;
perhaps a field `instance`, too. For all of the other methods:
  pip install cut-pursuit-py pgeof open3d-cpu hdbscan"""

SCALE = """examples:
  ellipseg evaluate scale sim:roadway
  ellipseg evaluate scale drive.mcap scan.npz --set max_points_per_second=15000 -o scale

One run over each scene; the hierarchy of its objects is then cut at a sixty-fourth to 64 times
objects.scale. Quality is shown of scenes whose points have a class, as for `partition`."""
