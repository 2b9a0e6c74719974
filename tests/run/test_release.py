"""The workflow of a release, and the comparison of its tag with version and date."""

import importlib.util
import os
import re
import shutil
from pathlib import Path

import pytest

import pw_elements

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
# a version or a commit
PINNED_ACTION = r"[\w-]+/[\w/-]+@(v\d+(\.\d+)*|[0-9a-f]{40})"


def load_workflow(name):
    """Return a workflow as a dictionary; YAML reads the key `on` as True."""
    yaml = pytest.importorskip("yaml")
    return yaml.safe_load((ROOT / ".github" / "workflows" / name).read_text())


def load_tag_script():
    """Return the module `.ci/tag.py`."""
    specification = importlib.util.spec_from_file_location("tag", ROOT / ".ci" / "tag.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def list_required_jobs(jobs, name):
    """Return the names of the jobs that have to succeed before a job starts."""
    needs = jobs[name].get("needs", [])
    names = [needs] if isinstance(needs, str) else needs
    return {*names, *(first for one in names for first in list_required_jobs(jobs, one))}


def list_steps(job, key):
    """Return the values of a key in the steps of a job."""
    return [step[key] for step in job["steps"] if key in step]


def test_a_release_starts_from_a_tag_and_after_all_checks():
    workflow = load_workflow("release.yml")
    assert workflow[True] == {"push": {"tags": ["v*"]}}
    commands = list_steps(workflow["jobs"]["build"], "run")
    expected_order = ['python3 .ci/tag.py "$GITHUB_REF_NAME"', ".ci/run", ".ci/build dist"]
    assert [command for command in commands if command in expected_order] == expected_order
    for name in workflow["jobs"].keys() - {"build"}:
        assert "build" in list_required_jobs(workflow["jobs"], name), name


def test_a_release_publishes_what_was_built_without_a_password():
    jobs = load_workflow("release.yml")["jobs"]
    publishing_steps = [step for step in jobs["publish"]["steps"] if "pypi-publish" in step["uses"]]
    assert [step.keys() for step in publishing_steps] == [{"uses"}]  # all by default
    (downloaded,) = list_steps(jobs["publish"], "with")
    assert downloaded in list_steps(jobs["build"], "with")
    assert downloaded["path"] == "dist"  # the default of the action that publishes
    assert "secrets." not in (ROOT / ".github" / "workflows" / "release.yml").read_text()


def test_a_release_deploys_the_site_that_was_checked():
    jobs = load_workflow("release.yml")["jobs"]
    uploads = [s for s in jobs["build"]["steps"] if "upload-pages-artifact@" in s.get("uses", "")]
    assert [step["with"] for step in uploads] == [{"path": "results/site"}]
    assert "results/site" in (ROOT / ".ci" / "run").read_text()
    assert [uses.partition("@")[0] for uses in list_steps(jobs["site"], "uses")] == [
        "actions/deploy-pages"
    ]


def test_each_job_of_a_release_has_only_the_permissions_that_it_needs():
    workflow = load_workflow("release.yml")
    assert workflow["permissions"] == {"contents": "read"}
    assert {name: job.get("permissions") for name, job in workflow["jobs"].items()} == {
        "build": None,
        "publish": {"id-token": "write"},
        "release": {"contents": "write"},
        "site": {"pages": "write", "id-token": "write"},
    }


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_workflows_pin_their_actions_and_call_scripts_that_exist(path):
    text = path.read_text()
    assert "://" not in text  # no addresses
    jobs = load_workflow(path.name)["jobs"].values()
    actions = [action for job in jobs for action in list_steps(job, "uses")]
    assert actions
    for action in actions:
        assert re.fullmatch(PINNED_ACTION, action), action
    commands = [command for job in jobs for command in list_steps(job, "run")]
    scripts = {name for c in commands for name in re.findall(r"(?:\./|\.ci/)[\w./-]+", c)}
    assert scripts
    for script in scripts:
        assert (ROOT / script).is_file(), script
        assert script.endswith(".py") or os.access(ROOT / script, os.X_OK), script


@pytest.mark.parametrize(
    ("file", "old", "new", "fault"),
    [
        (None, "", "", None),
        ("pw_elements/__init__.py", '"{version}"', '"9.9.9"', "has another __version__ than"),
        ("CHANGELOG.md", "## {version} (", "## {version} (not yet, ", "first heading"),
        ("CHANGELOG.md", "## {version} (", "## 9.9.9 (", "first heading"),
        ("CITATION.cff", "version: {version}", "version: 9.9.9", "CITATION.cff has another"),
        ("CITATION.cff", "date-released: 2", "date-released: 1", "CITATION.cff has another"),
    ],
)
def test_a_tag_has_to_agree_with_version_and_date(tmp_path, file, old, new, fault):
    version = pw_elements.__version__
    for name in ("pw_elements/__init__.py", "CHANGELOG.md", "CITATION.cff"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    if file:
        text = (tmp_path / file).read_text()
        changed = text.replace(old.format(version=version), new.format(version=version), 1)
        assert changed != text
        (tmp_path / file).write_text(changed)
    faults = load_tag_script().find_faults(tmp_path, f"v{version}")
    assert len(faults) == bool(fault), faults
    assert all(fault in line for line in faults)


@pytest.mark.parametrize("tag", ["0.1.0", "v0.1", "v0.1.0rc1", "v9.9.9"])
def test_other_tags_than_that_of_the_version_are_refused(tag):
    assert load_tag_script().find_faults(ROOT, tag)
