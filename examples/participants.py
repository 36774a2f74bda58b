"""An experiment with participants from its file to its report; here simulated people take part.

In a laboratory, people drive in the browser. The protocol, the folder and the report are the same.
"""

import argparse
from pathlib import Path

from agents.evaluation.evaluate import drive_episode, make_env
from agents.people.protocol import Protocol
from agents.people.report import write_report
from agents.people.session import Session
from agents.policies import make_policy
from wheelchair_gym.base.settings import read

parser = argparse.ArgumentParser()
parser.add_argument("--out", default="runs/participants")
folder = parser.parse_args().out
protocol = read(Protocol, Path(__file__).with_name("participants.json"))
helps = {condition.name: condition.assist for condition in protocol.conditions}
tasks = {task.name: task for task in (*protocol.practice, *protocol.tasks)}
for participant in (1, 2):
    session = Session(folder, protocol, participant)
    while step := session.next():
        if step.kind == "consent":
            session.consent()
        elif step.kind == "drive":
            task = tasks[step.task]
            helper = make_policy({"name": "assisted", "assist": helps[step.condition]})
            person = ("expert", "novice")[participant - 1]
            env = make_env(task.scene, {"driver": person, "shield": {}})
            session.drive(step, drive_episode(env, helper, task.seed))
            env.close()
        else:
            items = protocol.items(step.questionnaire)
            session.answer(step, [item.values[len(item.values) // 2] for item in items])
tables, page = write_report(folder)
print(tables[1].text())
print(page)
