"""The action, the workflow and the GitLab example are valid and use only existing names."""

import os
import re
import subprocess
import sys

import pytest
import yaml

from tests.paths import ROOT

ACTION = yaml.safe_load((ROOT / "action.yml").read_text())
WORKFLOW = yaml.safe_load((ROOT / ".github/workflows/compare.yml").read_text())
GITLAB = yaml.safe_load((ROOT / "docs/ci/gitlab-ci.yml").read_text())
STEPS = ACTION["runs"]["steps"]


def get_script(name: str) -> str:
    (script,) = (step["run"] for step in STEPS if step.get("name") == name)
    return script


def find_values(value: object) -> set[str]:
    """Return the expressions in ${{ }} in a YAML value."""
    return set(re.findall(r"\$\{\{\s*(.*?)\s*\}\}", str(value)))


def test_action_uses_declared_inputs_and_steps():
    named = {name for text in find_values(ACTION) for name in re.findall(r"inputs\.([\w-]+)", text)}
    named |= set(re.findall(r"inputs\.([\w-]+)", " ".join(str(s.get("if", "")) for s in STEPS)))
    assert named == set(ACTION["inputs"])
    steps = {name for text in find_values(ACTION) for name in re.findall(r"steps\.(\w+)", text)}
    assert steps <= {step["id"] for step in STEPS if "id" in step}


@pytest.mark.parametrize("step", [s for s in STEPS if "run" in s], ids=lambda s: s["name"])
def test_scripts_are_valid_and_read_values_from_the_environment(step, tmp_path):
    assert step["shell"] == "bash"
    assert not find_values(step["run"])  # inputs must never be executed as code
    script = tmp_path / "script.sh"
    script.write_text(step["run"])
    subprocess.run(["bash", "-n", script], check=True)
    assigned = set(re.findall(r"(?:^|\s)(?:mapfile -t )?(\w+)(?:=| < <)", step["run"]))
    used = set(re.findall(r"\$\{?(\w+)", step["run"]))
    variables = {"GITHUB_OUTPUT", *assigned, *step.get("env", {})}
    assert {name for name in used if not name.isdigit()} <= variables


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        *(
            (name, "--scene city '--limit 3", "No closing quotation: --scene city '--limit 3")
            for name in ("RUN", "COMPARE", "PACKAGES")
        ),
        ("RUN", "--scene 'my\ntown.gpkg'", "a line break inside quotes"),
    ],
)
def test_invalid_quotes_exit_with_2(name, text, problem):
    """An unclosed quote must not drop the options after it."""
    (step,) = (s for s in STEPS if name in s.get("env", {}))
    values = {"RUN": "--scene city", "COMPARE": "", "FOLDER": "/nowhere"}
    environment = {**os.environ, **values, "ACTION": str(ROOT), name: text}
    script = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]]
    done = subprocess.run(script, env=environment, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == f"error: input {name.lower()}: {problem}\n"


def test_last_step_exits_with_the_code_of_compare():
    script = get_script("Exit with the code of compare")

    def exit_code_of(code: str, strict: str = "false") -> int:
        environment = {**os.environ, "CODE": code, "STRICT": strict}
        return subprocess.run(["bash", "-e", "-c", script], env=environment).returncode

    assert [exit_code_of(code) for code in ("0", "1", "2", "4", "5", "")] == [0, 1, 2, 4, 0, 2]
    assert exit_code_of("5", strict="true") == 5


def test_workflow_measures_the_city_and_may_only_comment():
    (job,) = WORKFLOW["jobs"].values()
    (step,) = (step for step in job["steps"] if step["uses"] == "./")
    assert "--scene city " in step["with"]["run"]
    assert WORKFLOW["permissions"] == {"contents": "read", "pull-requests": "write"}


def test_gitlab_example_uses_existing_commands_and_files():
    job = GITLAB["rasterising"]
    lines = " ".join([*job["before_script"], *job["script"]])
    scripts = re.findall(r"\$HARNESS/(\S+)", lines)
    assert scripts == ["scripts/setup.sh", "scripts/ci-compare.sh"]
    assert all(os.access(ROOT / script, os.X_OK) for script in scripts)
    assert job["allow_failure"]["exit_codes"] == 5
    assert job["artifacts"]["reports"]["junit"].endswith("compare.xml")


@pytest.mark.parametrize(
    ("text", "taken"),
    [
        ("", []),
        ("--scene city --quick", ["--scene", "city", "--quick"]),
        ("--scene city\n--triangulators a,b\n", ["--scene", "city", "--triangulators", "a,b"]),
        ("--scene 'my file.geojson'\n --limit 3", ["--scene", "my file.geojson", "--limit", "3"]),
        ("--scene $(touch x) `touch x`", ["--scene", "$(touch", "x)", "`touch", "x`"]),
    ],
)
def test_options_may_have_several_lines_and_are_not_executed(text, taken, tmp_path):
    scripts = tmp_path / "scripts"
    scripts.mkdir()
    (tmp_path / ".venv").symlink_to(ROOT / ".venv")
    (scripts / "split_options.py").symlink_to(ROOT / "scripts/split_options.py")
    fake = scripts / "ci-compare.sh"
    fake.write_text('#!/bin/sh\nfor each in "$@"; do echo "$each"; done > told\n')
    fake.chmod(0o755)
    environment = {"PATH": os.environ["PATH"], "ACTION": str(tmp_path), "FOLDER": "f"}
    environment |= {"RUN": text, "COMPARE": "", "BESIDE": "", "GITHUB_OUTPUT": "output"}
    command = ["bash", "-e", "-o", "pipefail", "-c", get_script("Measure and compare")]
    subprocess.run(command, cwd=tmp_path, env=environment, check=True)
    arguments = (tmp_path / "told").read_text().splitlines()
    assert arguments == ["f/baseline", "f/reports", "--", *taken]
    assert not (tmp_path / "x").exists()


def test_workflows_use_existing_inputs():
    text = (ROOT / "docs/how-to/ci.md").read_text()
    examples = [yaml.safe_load(block) for block in re.findall(r"```yaml\n(.*?)```", text, re.S)]
    jobs = [job for workflow in (WORKFLOW, *examples) for job in workflow["jobs"].values()]
    steps = (step for job in jobs for step in job["steps"])
    used = [s["with"] for s in steps if s["uses"] == "./" or "raster-harness" in s["uses"]]
    assert len(used) >= 3
    assert all(set(example) <= set(ACTION["inputs"]) for example in used)


def test_script_stores_a_first_baseline_or_prints_its_usage(tmp_path):
    done = subprocess.run([ROOT / "scripts/ci-compare.sh"], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.strip().startswith("scripts/ci-compare.sh BASELINE OUT")
    command = [ROOT / "scripts/ci-compare.sh", "kept/baseline", "out", "--gate", "counters", "--"]
    command += ["--scene", "city:buildings=2", "--quick", "--budget", "0.001"]
    command += ["--rasterisers", "tests.mock:MockRasteriser", "--triangulators", "delaunay"]
    environment = {**os.environ, "KEEP": "yes", "PYTHON": sys.executable}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "No baseline yet: kept/baseline" in done.stdout
    assert (tmp_path / "kept/baseline/cases.jsonl").read_text()
    reports = {path.name for path in (tmp_path / "out").iterdir()}
    assert reports == {"head", "compare.md", "compare.xml", "compare.json", "compare.html"}


def test_actions_are_pinned_by_commit():
    files = [ROOT / "action.yml", *(ROOT / ".github/workflows").glob("*.yml")]
    files.append(ROOT / "docs/how-to/ci.md")
    used = [use for file in files for use in re.findall(r"uses: (\S+)", file.read_text())]
    external = [use for use in used if use != "./" and not use.startswith("OWNER/")]
    assert len(external) > 8
    assert all(re.fullmatch(r"[\w/-]+@[0-9a-f]{40}", use) for use in external)


@pytest.mark.parametrize(
    ("name", "marked"),
    [
        ("city", "city"),
        ("glyphs 2.0_x-y", "glyphs 2.0_x-y"),
        ('")) | error("x', "--- - error--x"),
        ("a --> @someone\\`id`$(id)\n", "a --- -someone--id---id--"),
        ("\u00e9", "--"),
    ],
)
def test_names_cannot_end_the_comment_or_the_jq_program(name, marked, tmp_path):
    gh = tmp_path / "gh"
    gh.write_text('#!/bin/sh\nfor each in "$@"; do echo "$each" >> "$LOG"; done\n')
    gh.chmod(0o755)
    (tmp_path / "compare.md").write_text("report\n")
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}", "NAME": name}
    environment |= {"REPORT": str(tmp_path / "compare.md"), "LOG": str(tmp_path / "log")}
    environment |= {"REPOSITORY": "a/b", "NUMBER": "7"}
    command = ["bash", "-e", "-c", get_script("Comment")]
    subprocess.run(command, env=environment, cwd=tmp_path, check=True)
    marker = f"<!-- raster-harness compare: {marked} -->"
    assert (tmp_path / "comment.md").read_text() == f"report\n{marker}\n"
    program = next(line for line in (tmp_path / "log").read_text().splitlines() if "select" in line)
    assert f'contains("{marker}")' in program
    assert program.endswith("| .id")
