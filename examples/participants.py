"""Simulated people take part in an experiment; in a laboratory, people drive in the browser."""

import argparse
from functools import partial
from pathlib import Path

from agents.evaluation.evaluate import drive_episode, make_env
from agents.people import is_shielded
from agents.people.protocol import Protocol
from agents.people.report import write_report
from agents.people.session import Session
from agents.policies import make_policy
from wheelchair_gym.base.settings import read

parser = argparse.ArgumentParser()
parser.add_argument("--out", default="runs/participants")
parser.add_argument("--people", type=int, default=6)
given = parser.parse_args()
protocol = read(Protocol, Path(__file__).with_name("participants.json"))
helps = {condition.name: condition.assist for condition in protocol.conditions}
tasks = {task.name: task for task in (*protocol.practice, *protocol.tasks)}
for participant in range(1, given.people + 1):
    session = Session(given.out, protocol, participant)
    while step := session.next():
        if step.kind == "consent":
            session.consent()
        elif step.kind == "drive":
            assist, person = helps[step.condition], ("expert", "novice")[participant % 2]
            helper = make_policy({"name": "assisted", "assist": assist})
            settings = {"driver": person, "shield": is_shielded(assist)}
            with make_env(tasks[step.task].scene, settings) as env:
                session.drive(step, partial(drive_episode, env, helper))
        else:
            items = protocol.items(step.questionnaire)
            session.answer(step, [item.values[len(item.values) // 2] for item in items])
    session.close()
tables, page = write_report(given.out)
print(tables[1].text())
print(page)
