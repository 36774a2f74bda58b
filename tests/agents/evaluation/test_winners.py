"""Paired tests decide the winner of each scene."""

from agents.evaluation.compare import best_of, level_with, ranked, ranking_table, winners
from agents.evaluation.statistics import share, wilson


def evaluation(successes):
    """Return records and summary of policies, from {(policy, scene): successes by seed}."""
    records, summary = [], []
    for (policy, scene), of in successes.items():
        records += [{"policy": policy, "scene": scene, "seed": seed, "success": success}
                    for seed, success in enumerate(of)]  # fmt: skip
        low, high = wilson(sum(of), len(of))
        summary.append({"policy": policy, "scene": scene, "success": sum(of) / len(of),
                        "success_low": low, "success_high": high, "spl": 0.5,
                        "collision": 0.0, "collision_low": 0.0, "collision_high": 0.1})  # fmt: skip
    policies = list(dict.fromkeys(policy for policy, _ in successes))
    for policy in policies:
        of = [row["success"] for row in summary if row["policy"] == policy]
        summary.append({"policy": policy, "scene": "all", "success": sum(of) / len(of),
                        "spl": 0.5, "collision": 0.0})  # fmt: skip
    scenes = list(dict.fromkeys(scene for _, scene in successes))
    return {"policies": policies, "scenes": scenes, "records": records, "summary": summary}


def test_policies_are_level_where_their_pairs_cannot_tell():
    every = dict.fromkeys(range(20), True)
    assert level_with(every, every)
    five, six = ({**every, **dict.fromkeys(range(n), False)} for n in (5, 6))
    assert level_with(every, five)  # 2 x 0.5 ^ 5 = 0.0625
    assert not level_with(every, six)  # 0.03125
    other = {**every, 19: False, 18: False}
    assert level_with(other, six)  # 2 against 6 that differ
    assert level_with(every, {30: False})  # no seed of both


def test_the_best_of_each_scene_and_its_equals_win_there():
    good, fair, bad = [True] * 20, [True] * 17 + [False] * 3, [False] * 20
    found = evaluation({
        ("a", "hall"): good, ("b|<", "hall"): fair, ("c", "hall"): bad,
        ("a", "door"): bad, ("b|<", "door"): fair, ("c", "door"): bad,
    })  # fmt: skip
    assert winners(found) == {"hall": ["a", "b|<"], "door": ["b|<"]}
    table = ranking_table(found)
    lines = table.markdown().splitlines()
    assert lines[0] == "| policy | hall [%] | door [%] |"
    assert lines[2] == "| b\\|< | **85.0** (64.0-94.8) | **85.0** (64.0-94.8) |"
    assert lines[3] == "| a | **100.0** (83.9-100.0) | 0.0 (0.0-16.1) |"
    page = table.html()
    assert page.count("<strong>") == 3
    assert "b|&lt;" in page


def test_nobody_wins_where_nobody_arrives_or_where_too_few_episodes_tell():
    never, few = [False] * 20, [True] * 5
    both = evaluation({("a", "hall"): never, ("b", "hall"): never, ("a", "door"): [True] * 20,
                       ("b", "door"): never})  # fmt: skip
    assert winners(both) == {"hall": [], "door": ["a"]}
    both = evaluation({(p, s): few for p in "ab" for s in ("hall", "door")})
    assert ranking_table(both) is None


def row(name, contacts, successes, n=100):
    return {"policy": name, "scene": "all", "spl": 0.5, **share("collision", contacts, n),
            **share("success", successes, n)}  # fmt: skip


def test_contacts_count_before_success_and_no_best_is_named_where_intervals_overlap():
    careful, quick, lame = row("careful", 2, 80), row("quick", 30, 95), row("lame", 0, 20)
    assert [one["policy"] for one in ranked([quick, careful, lame])] == ["lame", "careful", "quick"]
    assert best_of(ranked([quick, careful])) is careful
    assert best_of(ranked([careful, lame])) is None  # contacts overlap, and fewer arrive
    assert best_of(ranked([row("a", 0, 99), row("b", 3, 40)]))["policy"] == "a"
    assert best_of(ranked([row("a", 0, 95), row("b", 0, 99)])) is None
    assert best_of([careful]) is careful
    assert best_of([]) is None
