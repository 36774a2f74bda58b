"""The table of commands: a row has the name, the function that runs it, help and options.

Nothing here imports more than the standard library, so that `--help` answers at once; the function
of a command is imported when the command runs.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from agents.cli.options import (
    ALGORITHMS,
    CHAIR,
    CHAIR_CONFIG,
    CONFIG,
    END_PICTURE,
    HARDWARE_CONFIG,
    JSON,
    MAP_FILES,
    OTHERS,
    POLICY_HELP,
    POSE,
    POSES,
    QUIET,
    RECORD,
    RESOLUTION,
    SECONDS,
    SHIELD,
    TRAINING_ENVIRON,
    UNKNOWN,
    VIDEO,
    WINDOW,
    WORKERS,
    OneOf,
    Option,
    count,
    counts,
    deadlines,
    finite,
    flag,
    map_options,
    names,
    non_negative,
    number,
    option,
    parse_int,
    pose,
    poses,
    record,
    seed,
    share,
)


class Command(NamedTuple):
    """A command, or a subcommand such as `bench env`."""

    name: str
    run: str  # module:function, which takes the parsed arguments and returns the exit code
    help: str
    description: str
    example: str
    options: Sequence[Option | OneOf]
    environ: Mapping[str, str] = MappingProxyType({})


GROUPS = {
    "bench": (
        "measure the speed of environments, or compare planners",
        "wheelchair bench env --beams 1081 --envs 1024 --threads 2",
    ),
    "hardware": (
        "check, set up, tune, calibrate, monitor and hand-drive a real chair",
        f"wheelchair hardware check --config {CHAIR_CONFIG}",
    ),
}

COMMANDS = (
    Command(
        "plan", "plan:run", "plan a path in a map, or in each problem of a JSON file",
        "Plan a path. Exit code 0: solved; 1: no path was found; 2: wrong input.",
        "wheelchair plan --map hall.yaml --start 1,2 --goal 9,4 --planner rrt_star "
        "--set iterations=30000",
        [
            option("--planner", "planner: a name of `wheelchair settings`, module:Class, or "
                   "FILE.json:NAME as in configs/planners.json (default: rrt_star_woa_global)"),
            option("--config", "settings file of the thesis (docs/studies/thesis.md): planner, map "
                   "and what to draw; other options override it", None, "FILE.json"),
            option("--set", "change a setting of the planner, such as tree.iterations=30000; "
                   "repeatable", None, "KEY=VALUE", action="append", default=[], dest="changes"),
            option("--map", MAP_FILES, None, "FILE"), RESOLUTION, UNKNOWN,
            option("--problems", "file of problems (docs/how_to/files.md), in place of a map", None,
                   "FILE.json"),
            option("--start", "start on the map [m, m, rad]", pose),
            option("--goal", "goal on the map [m, m, rad]", pose),
            option("--clearance", "distance to obstacles [m] (default 0.36 in a map, 0 in "
                   "problems)", non_negative),
            seed("the planner"),
            option("--picture", "draw the map and the path (.png)", None, "FILE"),
            option("--video", "film how the tree grows, with --config the roll-out of the "
                   "commands, too (.mp4, .gif)", None, "FILE"), JSON,
        ],
    ),
    Command(
        "simulate", "drive:simulate", "drive one episode, in a window, to a video or to a picture",
        "Drive one episode and print its result.",
        "wheelchair simulate --scene floor_plan --policy a_star+pure_pursuit --seed 3 "
        "--video drive.mp4",
        [
            option("--scene", "scene: a name of `wheelchair scenes`, module:Class, or "
                   "FILE.json:NAME as in configs/scenes.json (default: the config's, or "
                   "floor_plan)"),
            *map_options(),
            option("--policy", POLICY_HELP, default="lattice+window"), seed(),
            option("--driver", "a simulated person drives, in place of a policy: expert, novice, "
                   "... (configs/drivers.json), module:function or FILE.json:NAME"),
            option("--assist", "with --driver: the assistant, direct for none (default slide)"),
            option("--chair", f"drive {CHAIR} (default: a simulated one); --goal is on its own "
                   "map, and --start its pose X,Y,YAW where it does not report it", None, "CHAIR"),
            CONFIG, POSE, SHIELD, OneOf((WINDOW, VIDEO, END_PICTURE)), *RECORD, JSON,
        ],
    ),
    Command(
        "studio", "studio:studio", "drive, plan and compare in the browser, in the simulator",
        "Serve a page on this machine until Ctrl-C, and print its address: people drive the "
        "simulated chair by keys, gamepad, touch or a single switch, with and without help. Each "
        "drive is recorded. Needs the extra 'studio'; recordings need 'record'.",
        "wheelchair studio --map wheelchair_gym/maps/data/clinic.yaml",
        [
            *map_options(),
            option("--port", "TCP port; 0: a free one", number(int, 0, 65535), "PORT",
                   default=8780),
            flag("--lan", "let other machines of the network come, who know the address with its "
                 "token"),
            option("--study", "protocol of an experiment with participants, whose data go to a "
                   "folder of its name in --out", None, "FILE.json"),
            option("--out", "folder of recordings, films and maps", None, "DIR",
                   default="runs/studio"),
            option("--runs", "folder below which the page Compare finds recordings and runs of "
                   "`compare`", None, "DIR", default="runs"),
        ],
    ),
    Command(
        "replay", "replay:run", "judge, draw or re-run a recorded run",
        "Judge each episode of a recording again. Exit code 1: rewards differ from the recorded "
        "ones in at least one bit.",
        "wheelchair replay run.mcap --policy lattice+window --video run.mp4",
        [
            option("file", "a recording of `simulate --record`, of either format", None,
                   "FILE.mcap"),
            option("--episode", "replay only this episode, counted from 0", parse_int),
            OneOf((
                option("--policy", f"compare the actions of this {POLICY_HELP}"),
                option("--assist", "of a person's drive: what this assistant would have made of "
                       "the recorded stick"),
            )),
            OneOf((VIDEO, END_PICTURE)), *RECORD, JSON,
        ],
    ),
    Command(
        "compare", "compare:compare", "compare policies on scenes, and write a report",
        "Run a suite of episodes, each policy on each scene and seed. Finished episodes are "
        "stored: the same command after Ctrl-C runs only the missing ones.",
        "wheelchair compare --suite demo --jobs 2 --out runs/demo",
        [
            option("--suite", "suite: barn, clinic, corridor, crossing, crowd, cylinders, demo, "
                   "doors, followers, homes, league, lift, lobby, people, skills, temporary, "
                   "thesis or whales",
                   default="demo"),
            option("--policies", "policies, in place of the suite's: PLANNER+FOLLOWER, "
                   "module:Class, a file of weights (.npz, .onnx), a model of stable-baselines3 "
                   "(.zip, which runs code), ...", names),
            option("--trained-in", "settings of the environment that models of stable-baselines3 "
                   "were trained in, where their .zip does not hold them", None, "FILE.json"),
            option("--driver", "simulated people who drive, in place of policies: expert, novice, "
                   "... (configs/drivers.json), module:function or FILE.json:NAME", names),
            option("--assist", "with --driver: assistants that are compared (default: all)",
                   names),
            option("--scenes", "scenes, in place of the suite's: a name, module:Class, "
                   "FILE.json:NAME as in configs/scenes.json, or FILE.json: all worlds of a BARN "
                   "file", names),
            *map_options(names),
            option("--episodes", "episodes of each policy on each scene (default: the suite's)",
                   count),
            option("--first-seed", "seed of the first episode", parse_int, default=0),
            flag("--training-seeds", "drive training worlds, to choose settings"),
            CONFIG,
            option("--pose", f"source of the estimated pose: {', '.join(POSES)} (slam: the map is "
                   "unknown); several are compared (default: the config's, or the suite's)", poses),
            SHIELD, WORKERS,
            option("--out", "folder of the results (default runs/SUITE, or a folder called as "
                   "the scenes or maps)", None, "DIR"),
            flag("--no-video", "write no video"), QUIET,
            option("--columns", "columns of the table in the terminal, or all; the report has all",
                   names, default=["episodes", "success", "collision", "at_fault", "spl", "time"]),
            *record("DIR", "one file for each episode"), JSON,
        ],
    ),
    Command(
        "convert", "map:convert", "write a map or an image of a floor plan as a map_server file",
        "Write a map as a map_server YAML file with its image, for ROS and for other programs.",
        "wheelchair convert plan.png --resolution 0.05 --out plan.yaml",
        [
            option("file", MAP_FILES, None, "FILE"), RESOLUTION,
            option("--out", "the YAML file (default: the map's name, in this folder)", None,
                   "FILE.yaml"), JSON,
        ],
    ),
    Command(
        "dataset", "train:dataset", "write episodes of a policy as a data set for offline learning",
        "Drive episodes and write observations, actions and rewards as a Minari data set. Ctrl-C "
        "keeps the episodes driven so far. Needs the extra 'dataset'.",
        "wheelchair dataset wheelchair/homes-v0 --policy lattice+window --episodes 100",
        [
            option("name", "name of the data set, such as wheelchair/homes-v0", None, "NAME"),
            option("--policy", POLICY_HELP, default="lattice+window"),
            option("--scene", f"a scene, {OTHERS} (default: floor_plan)"), *map_options(),
            option("--episodes", "number of episodes", count, default=100),
            option("--first-seed", "seed of the first episode, of training worlds", parse_int,
                   default=0),
            CONFIG, POSE, SHIELD,
            option("--out", "folder of data sets", None, "DIR", default="runs/datasets"), QUIET,
            JSON,
        ],
    ),
    Command(
        "report", "compare:participants", "compare the conditions of an experiment with people",
        "Compare conditions pair by pair; write report.html and data.csv into the folder.",
        "wheelchair report runs/doorways",
        [option("folder", "folder of the experiment", None, "DIR"), JSON],
    ),
    Command(
        "study", "compare:study", "repeat the experiments of the source documents",
        "Run the experiment of a table or figure of the sources, compare its figures with the "
        "published ones, and test its claims. Finished runs are stored: the same command after "
        "Ctrl-C, or with more runs, runs only the missing ones.",
        "wheelchair study t1-3.5 --runs 100 --jobs 2",
        [
            option("name", "study: t1-3.1 to t1-3.13, t1-1.1, p1, p2, r1, t2, control, or all",
                   None, "NAME"),
            OneOf((
                flag("--quick", "make few runs, for a first look"),
                option("--runs", "runs of each row and map or goal (default 100 or 400, by study)",
                       count),
            )),
            WORKERS, option("--out", "folder of the results", None, "DIR", default="runs/study"),
            QUIET, JSON,
        ],
    ),
    Command(
        "tune", "compare:tune", "search for settings of a policy",
        "Search for settings by Optuna, on training worlds. The policy (PLANNER+FOLLOWER) is "
        "evaluated on the scenes of a suite. The first trial has the "
        "current settings. The best trial is evaluated again on other episodes. The same command "
        "after Ctrl-C, or with more trials, continues.",
        "wheelchair tune lattice+window --vary follower.objective.clearance=0.05:1 --suite homes "
        "--trials 40",
        [
            option("name", "a policy, or FILE.json:NAME", None, "NAME"),
            option("--vary", "a setting and its range: KEY=LOW:HIGH, KEY=LOW:HIGH:log or "
                   "KEY=A,B,C; repeatable", None, "KEY=LOW:HIGH", action="append", required=True),
            option("--trials", "total number of trials", count, default=40),
            option("--episodes", "episodes of each scene in a trial", count, default=20),
            option("--suite", "suite whose scenes it is evaluated on (default homes)"),
            option("--scenes", "scenes, in place of a suite's",
                   names),
            option("--metric", "score of an episode: sct (default; success weighted by "
                   "completion time), spl, success, barn or barn_own"),
            seed("Optuna"), CONFIG, POSE, SHIELD, WORKERS,
            option("--out", "folder of the results (default runs/tune/NAME)", None, "DIR"), QUIET,
            JSON,
        ],
    ),
    Command(
        "map", "map:run", "build a map: by exploring a scene, from a recording or from a log",
        "Build a map by SLAM. In a scene, or with a real chair, a policy drives through an unknown "
        "world; the map of a scene is compared with the true one. From a log in BreezySLAM's "
        "format (encoders and scans) or a recording of a chair, a map by odometry alone is built, "
        "too, and both are compared on scans that were held out.",
        "wheelchair map --scene floor_plan --seed 4 --picture map.png",
        [
            OneOf((
                option("--scene", "explore this scene, or FILE.json:NAME"),
                option("--chair", f"explore with {CHAIR}", None, "CHAIR"),
                option("--log", "read a log in BreezySLAM's format: one line a scan", None, "FILE"),
                option("--recording", "read the first episode of a chair's recording, or a ROS 2 "
                       "bag (MCAP or SQLite) of any robot", None, "PATH"),
            ), required=True),
            option("--scan-topic", "the bag's topic of scans (default: /scan, or the only one)",
                   default=""),
            option("--odometry-topic", "the bag's topic of odometry (default: /odom, or the only "
                   "one)", default=""),
            option("--policy", "policy that drives: explore, manual, ...", default="explore"),
            option("--time", "limit of the drive [s]", finite, default=900.0),
            WINDOW, CONFIG,
            option("--particles", "particles of SLAM; 1 is scan matching alone", count),
            seed("the episode, or of SLAM"),
            option("--out", "folder of map.yaml and map.pgm", None, "DIR", default="runs/map"),
            option("--picture", "draw the maps with the trail (.png)", None, "FILE"),
            flag("--odometry-only", "use no SLAM"), QUIET, *RECORD, JSON,
        ],
    ),
    Command(
        "train", "train:run", "train a policy, or resume a training run",
        "Train a policy. The folder keeps curve.csv, policy.npz (the latest), best.npz (the best "
        "in evaluation), checkpoint.pt and TensorBoard's log. The same command after Ctrl-C "
        "resumes from the last checkpoint, with the same result. With --vary, a table and a figure "
        "of the evaluations are written, too. bc imitates a scripted policy.",
        "wheelchair train ppo --config configs/ppo_guided.json --seeds 0,1 --jobs 2 --out runs/ppo",
        [
            option("algorithm", "learning algorithm", choices=ALGORITHMS),
            option("--config", "settings of the run, as in configs/ppo_guided.json", None,
                   "FILE.json"),
            option("--set", "change a setting, such as env.rate=10; repeatable", None, "KEY=VALUE",
                   action="append", default=[]),
            option("--vary", "train once for each value of a setting, and compare", None,
                   "KEY=A,B"),
            option("--frames", "environment steps of a run", count),
            option("--seeds", "seeds of the runs", names, default=["0"]),
            option("--jobs", "runs at once", count, default=1),
            option("--out", "folder of the run; with several seeds or --vary, of a folder for each "
                   "run (default runs/ALGORITHM)", None, "DIR"),
            QUIET, JSON,
        ],
        TRAINING_ENVIRON,
    ),
    Command(
        "export", "train:export", "write a learned policy as ONNX, or with a model card",
        "Write weights as an ONNX graph, which includes pooling, missing echoes, normalisation, "
        "clipping and scaling; FILE.json beside it describes inputs, outputs and settings. Or "
        "write the last weights of a training run's best seed with a model card, NAME.md: "
        "settings, curves of all seeds, results, limits.",
        "wheelchair export runs/ppo/policy.npz --onnx policy.onnx",
        [
            option("policy", "weights: a name, a file .npz or FILE.json:NAME; for --npz the folder "
                   "of a run"),
            OneOf((
                option("--onnx", "write the ONNX graph", None, "FILE.onnx"),
                option("--npz", "write the weights, with a card beside them", None, "NAME.npz"),
            ), required=True),
            option("--results", "results.json of comparisons, for the card", names, default=[]),
            JSON,
        ],
    ),
    Command(
        "scenes", "lists:scenes", "list the scenes, or measure one",
        "List the scenes; with a name, sample the scene and print distributions of its measures.",
        "wheelchair scenes floor_plan --samples 50",
        [
            option("name", "a scene to sample, or FILE.json:NAME", nargs="?"),
            option("--samples", "number of episodes", count, default=20), JSON,
        ],
    ),
    Command(
        "settings", "lists:settings", "print settings with default, unit, bounds and source",
        "Print the settings of parts of the chair, planners, followers, policies and scenes; "
        "without a name, list the names.",
        "wheelchair settings limits a_star",
        [
            option("names", "names of settings", nargs="*"),
            option("--markdown", "write all settings as a page; - is standard output", None,
                   "FILE.md"),
            JSON,
        ],
    ),
    Command(
        "bench env", "bench:env", "measure how fast environments step",
        "Measure how fast environments step on this machine, single and vectorized, and IR-SIM "
        "where it is installed (extra 'peers').",
        "wheelchair bench env --beams 1081 --envs 1024 --threads 2",
        [
            option("--beams", "beams of the laser", counts, default=[64, 128, 181, 1081]),
            option("--envs", "sizes of vector environments", counts,
                   default=[1, 16, 64, 256, 1024]),
            option("--threads", "threads of a vector environment", counts, default=[1, 2]),
            option("--bank", "number of worlds", count, default=2048),
            option("--seconds", "duration of each measurement [s]", finite, default=3.0),
            option("--driver", "simulated person: batches with and without it", None, "NAME"),
            option("--assist", "with --driver: a compiled assistant", None, "NAME"),
            flag("--no-peers", "measure no other simulator"),
            flag("--no-startup", "do not measure compilation and start"),
            option("--out", "folder of the results", None, "DIR", default="runs/bench"), JSON,
        ],
    ),
    Command(
        "bench planners", "bench:planners", "compare planners on the same problems",
        "Run every planner, and those of other packages where they are installed (extra 'peers'), "
        "on the same problems, on one core, judged by independent geometry: time to the first "
        "path, length at deadlines, success, validity, smoothness, clearance.",
        "wheelchair bench planners --map plan.png --resolution 0.05 --seeds 5 "
        "--planners rrt_star,visibility --plot planners.png",
        [
            option("--problems", "file of problems (docs/how_to/files.md), planned with clearance "
                   "of 0 m (default: one of each scene that needs no file, with 0.36 m)", None,
                   "FILE.json"),
            option("--only", "names of problems (default: all)", names, default=[]),
            *map_options(names),
            option("--planners", f"planners or peers, also {OTHERS} (default: all)", names),
            option("--peers", "run other packages' planners (default: the installed ones, unless "
                   "--planners is given)", action=argparse.BooleanOptionalAction),
            option("--seeds", "number of runs of each planner and problem", count, default=20),
            option("--deadlines", "deadlines [s]", deadlines, default=[0.01, 0.1, 1.0]),
            option("--resume", "continue the results in this file", None, "FILE"),
            option("--plot", "draw success and length over time (.png)", None, "FILE"),
            option("--out", "folder of the results", None, "DIR", default="runs/bench"), QUIET,
            JSON,
        ],
    ),
    Command(
        "twin", "twin:run", "serve emulated boards of a simulated chair",
        "Serve the twin in real time until Ctrl-C: a pseudo-terminal for each board, a TCP port "
        "for the laser. Lines on standard input inject faults; the line 'help' lists them.",
        f"wheelchair twin --config {CHAIR_CONFIG} --scene clutter --window",
        [
            option("--config", f"settings of the chair, as in {CHAIR_CONFIG}", None, "FILE.json"),
            option("--scene", "scene, or FILE.json:NAME (default: the config's)"), seed(),
            option("--port", "port of the laser; 0: a free one", parse_int, default=0), SECONDS,
            WINDOW,
            option("--write-map", "write the map of the world", None, "FILE.yaml"), END_PICTURE,
        ],
    ),
    Command(
        "robot", "twin:robot", "serve a simulated chair as a ROS 2 robot, which nav2 can drive",
        "Publish /scan, /odom, /tf, /battery_state and ultrasonics of a simulated chair in real "
        "time, and drive as /cmd_vel says, until Ctrl-C. It serves rosbridge's protocol itself, "
        "is a client of a rosbridge_server, or speaks DDS as ROS 2 does; ROS need not be "
        "installed. When /cmd_vel is silent for 0.5 s, the chair stops. Needs the extra 'ros', or "
        "'dds'.",
        "wheelchair robot --scene crowd --pose mcl --sim-time",
        [
            option("--scene", f"a scene, {OTHERS} (default: floor_plan)"), *map_options(), seed(),
            CONFIG, POSE, SHIELD,
            option("--rate", "rate of control, /odom, /tf and /clock [Hz]", number(float, 1, 200),
                   "HZ", default=50.0),
            option("--scan-rate", "rate of scans [Hz]", number(float, 0.1, 200), "HZ",
                   default=10.0),
            option("--sim-time", "stamp messages with simulated time on /clock, so many times as "
                   "fast as real time (1 if none is given); default: real time",
                   number(float, 0.01, 1000), "SPEED", nargs="?", const=1.0, default=0.0),
            flag("--no-map", "publish neither /map nor map -> odom: amcl or slam_toolbox does"),
            flag("--imu", "publish the turn rate on /imu"),
            option("--namespace", "prefix of topics, services and frames, such as robot1 (not of "
                   "/tf, /tf_static, /clock and the frame map)", None, "NAME"),
            option("--episodes", "end after so many episodes, each at its goal, a contact or its "
                   "time limit, and report the figures of `compare`; an episode begins with its "
                   "first /cmd_vel", count),
            option("--host", "address to serve at; with --dds, of a network interface", None,
                   "ADDRESS", default="127.0.0.1"),
            option("--port", "TCP port; 0: a free one", number(int, 0, 65535), "PORT",
                   default=9090),
            flag("--dds", "publish over DDS, without rosbridge, in the domain ROS_DOMAIN_ID"),
            option("--token-file", "file with the token that clients must send", None, "FILE"),
            option("--tls", "serve wss with the key and the certificate in this file", None,
                   "FILE.pem"),
            option("--rosbridge", "serve nothing, and be a client of this rosbridge_server: "
                   "ros://HOST:PORT, or FILE.json:NAME", None, "ROSBRIDGE"),
            flag("--stamped", "with --rosbridge: /cmd_vel is a TwistStamped (nav2 from Kilted on)"),
            SECONDS, WINDOW, *RECORD, JSON,
        ],
    ),
    Command(
        "deploy", "drive:deploy", "drive a real chair to a goal on a map",
        "Drive a real chair: it waits until a person re-arms it (Enter, or its joystick), drives "
        "slowly at first, and stops when a sensor is silent, a person takes over, or this program "
        "ends. Events are printed on standard error. Keep a hand at the emergency stop.",
        f"wheelchair deploy --config {CHAIR_CONFIG} --map clinic.yaml --start 1,2,0 --goal 6,3.5 "
        "--record run.mcap",
        [
            option("--policy", POLICY_HELP, default="lattice+window"), HARDWARE_CONFIG,
            option("--map", "map_server .yaml, MovingAI .map or HouseExpo .json", None, "FILE",
                   required=True), UNKNOWN,
            option("--goal", "goal on the map [m, m, rad]", pose, required=True),
            option("--start", "approximate pose of the chair [m, m, rad]", pose, "X,Y,YAW",
                   required=True),
            flag("--force-start", "confirm --start where the first scan fits badly or elsewhere"),
            option("--chair", CHAIR, None, "CHAIR", default="hardware"),
            option("--pose", "source of the estimated pose (default: the config's)",
                   choices=[p for p in POSES if p not in ("truth", "modelled")]),
            option("--initial-speed", "speed limit at the start [m/s] (default 0.2)", non_negative),
            option("--speed-ramp", "increase of the speed limit [m/s2] (default 0.05)",
                   non_negative),
            option("--max-speed", "end of the increase [m/s] (default: the chair's limit)",
                   non_negative),
            flag("--dry-run", "print the commands until Ctrl-C, and send none"), *RECORD, JSON,
        ],
    ),
    Command(
        "drive", "drive:assisted", "drive a real chair yourself, with an assistant",
        "Drive a real chair with the help of an assistant: hold the dead-man switch, and push the "
        "stick. The manual switch (M on the keyboard) takes the chair without help at any moment. "
        "It stops when the switch is let go, when the assistant is late or fails, or when this "
        "program ends. Keep a hand at the emergency stop.",
        f"wheelchair drive --config {CHAIR_CONFIG} --input board --record run.mcap",
        [
            option("--assist", "the assistant: shield for none but the shield, module:Class or "
                   "FILE.json:NAME", default="slide"), HARDWARE_CONFIG,
            option("--input", "what the person holds: the joystick of the drive board, a gamepad "
                   "at this computer, or keys in a window", default="board",
                   choices=("board", "gamepad", "keyboard")),
            flag("--prompts", "stand, and ask for one deflection after another, for fit-driver "
                 "(with --rate 50 and --record)"),
            option("--map", "map, for assistants that use one: map_server .yaml, MovingAI .map or "
                   "HouseExpo .json; with --start", None, "FILE"), UNKNOWN,
            option("--start", "approximate pose of the chair on it [m, m, rad]", pose, "X,Y,YAW"),
            option("--pose", "with --map: source of the estimated pose", default="mcl",
                   choices=[p for p in POSES if p not in ("truth", "modelled")]),
            option("--speed", "share of full speed at full deflection (default: "
                   "hardware.joystick.speed_fraction)", share),
            option("--rate", "rate of control [Hz]", number(float, 5, 50), "HZ", default=20.0),
            option("--deadline", "time for each answer of the assistant [s]",
                   number(float, 0.01, 5.0), "S", default=0.15),
            option("--chair", "hardware, or FILE.json:NAME as in configs/chairs.json", None,
                   "CHAIR", default="hardware"),
            SECONDS, *RECORD, JSON,
        ],
    ),
    Command(
        "fit-driver", "drive:fit", "fit a simulated person to recorded sessions of a real one",
        "Fit tremor and dead zone of a simulated person, from prompted sessions also delay, lag, "
        "weakness, rotation, offset and wrong signals, with 95 % intervals, and say what the "
        "sessions do not show. With --json FILE, the person drives by --driver FILE:fitted.",
        "wheelchair fit-driver session.mcap drive.mcap --json me.json",
        [
            option("logs", "recordings of one person with one interface", None, "FILE.mcap",
                   nargs="+"),
            option("--base", "simulated person whose other settings are kept: a name, "
                   "module:function or FILE.json:NAME", default="expert"),
            option("--repeats", "repetitions of the bootstrap", count, default=50),
            seed("the bootstrap"), JSON,
        ],
    ),
    Command(
        "hardware check", "hardware:check", "check all parts; the chair does not drive", "",
        f"wheelchair hardware check --config {CHAIR_CONFIG}",
        [HARDWARE_CONFIG, flag("--no-person", "do not check the emergency stop"), JSON],
    ),
    Command(
        "hardware setup", "hardware:setup", "write the config's parameters to the boards", "",
        f"wheelchair hardware setup --config {CHAIR_CONFIG}", [HARDWARE_CONFIG],
    ),
    Command(
        "hardware tune", "hardware:tune", "drive a step of the speed controller and plot it", "",
        f"wheelchair hardware tune --config {CHAIR_CONFIG} --plot step.png",
        [
            HARDWARE_CONFIG,
            option("--step", "its height [m/s, with --turn rad/s]", non_negative, default=0.3),
            option("--seconds", "duration of the step [s]", non_negative, default=2.0),
            flag("--turn", "turn in place"),
            option("--set", "try a gain: kp, ki, kd, ka or smoothing; `hardware setup` saves gains",
                   None, "GAIN=VALUE", action="append", default=[]),
            option("--plot", "draw the step", None, "FILE"), JSON,
        ],
    ),
    Command(
        "hardware calibrate", "hardware:calibrate",
        "measure counts per metre, or the track by squares (UMBmark)", "",
        f"wheelchair hardware calibrate --config {CHAIR_CONFIG} --write",
        [
            HARDWARE_CONFIG,
            option("quantity", "distance: counts per metre; track: the track, after the distance",
                   nargs="?", choices=("distance", "track"), default="distance"),
            option("--runs", "number of runs there and back", count, default=2),
            option("--distance", "driven straight towards a wall [m]", non_negative, default=1.5),
            flag("--tape", "distance: a person measures, where no wall is ahead"),
            flag("--push", "distance: a person pushes the chair, with its brakes released"),
            option("--side", "track: side of the square [m]", non_negative, default=4.0),
            flag("--write", "distance: write the result to the config and to the board"), JSON,
        ],
    ),
    Command(
        "hardware monitor", "hardware:monitor", "print all messages of the chair live", "",
        f"wheelchair hardware monitor --config {CHAIR_CONFIG}",
        [HARDWARE_CONFIG, flag("--yes", "open the ports even if that resets boards"), SECONDS],
    ),
    Command(
        "hardware drive", "hardware:drive", "drive by a joystick at the host", "",
        f"wheelchair hardware drive --config {CHAIR_CONFIG}",
        [
            HARDWARE_CONFIG, SECONDS,
            option("--timeout", "longest absence of a joystick [s]", non_negative, default=30.0),
        ],
    ),
)  # fmt: skip
