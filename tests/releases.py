"""What a release is made of, as far as it can be checked without making one: the workflow, its scripts, the bill of materials.

Usage: releases.py BILL; BILL is what packaging/sbom.py wrote. Wants the packages of `.ci/run`."""

import json
import re
import subprocess
import sys
from pathlib import Path

import yaml
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

ROOT = Path(__file__).resolve().parents[1]
WORKFLOW = ROOT / ".github" / "workflows" / "release.yml"


def check_workflow():
    """Steps are shell that parses, and call what is there; what a job waits for is a job."""
    jobs = yaml.safe_load(WORKFLOW.read_text())["jobs"]
    called = set()
    for name, job in jobs.items():
        needs = job.get("needs", [])
        for other in [needs] if isinstance(needs, str) else needs:
            assert other in jobs, f"{name} needs {other}, which is no job"
        for script in (step["run"] for step in job["steps"] if "run" in step):
            # what GitHub fills in goes by the environment: in a script it could be anybody's text
            assert "${{" not in script, f"{name}: {script}"
            subprocess.run(["bash", "-n"], input=script, text=True, check=True)
            called |= set(re.findall(r"(?:packaging|tests|\.ci)/[\w.]+", script))
    assert len(called) >= 5, called
    for path in sorted(called):
        assert (ROOT / path).is_file(), f"{WORKFLOW.name} calls {path}, which is not there"
    return len(jobs)


def check_bill(path):
    text = Path(path).read_text()
    error = JsonStrictValidator(SchemaVersion.V1_6).validate_str(text)
    assert error is None, error
    # crates that are in it for sure, each with its checksum and licence; those of tests are not
    parts = json.loads(text)["components"]
    crates = {of["name"]: of for of in parts}
    for name in ("arrow-array", "clarabel", "mcap"):
        assert crates[name]["hashes"] and crates[name]["licenses"], crates[name]
    assert "divan" not in crates and "protox" not in crates
    return len(parts)


print(f"{check_workflow()} jobs, {check_bill(sys.argv[1])} crates in the bill of materials")
