import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { test } from "node:test";
import { argumentsOf, findCommand, withSetup } from "../src/commandLine";

const NOTHING = { command: [], setupFiles: [], interpreter: "", folder: "/robot" };

test("the setting comes before what is found", () => {
  const at = { ...NOTHING, command: ["docker", "exec", "bench", "r2bspec"] };
  assert.deepEqual(findCommand(at, () => true), at.command);
});

test("the selected interpreter comes before the environment of the workspace, and that before the path", () => {
  const at = { ...NOTHING, interpreter: "/envs/bench/bin/python3" };
  assert.deepEqual(findCommand(at, () => true), ["/envs/bench/bin/r2bspec"]);
  const inWorkspace = (path: string): boolean => path.startsWith("/robot/");
  assert.deepEqual(findCommand(at, inWorkspace), ["/robot/.venv/bin/r2bspec"]);
  assert.deepEqual(findCommand(at, () => false), ["r2bspec"]);
});

test("setup files are sourced by a real bash, and what they print stays out of the output", () => {
  const folder = mkdtempSync(join(tmpdir(), "it's a robot-"));
  const setup = join(folder, "setup.bash");
  writeFileSync(setup, "echo noise; export ROBOT=arm\n");
  const show = ["sh", "-c", 'printf "%s|" "$ROBOT" "$@"', "show", "it's", "$(var rate)", ""];
  const [program, ...rest] = withSetup(show, [setup]);
  const said = execFileSync(program ?? "", rest, { encoding: "utf8", stdio: "pipe" });
  assert.equal(said, "arm|it's|$(var rate)||");
});

test("without setup files no shell is needed", () => {
  assert.deepEqual(withSetup(["r2bspec", "lsp"], []), ["r2bspec", "lsp"]);
});

test("commands about a spec are command lines", () => {
  const about = { file: "/robot/a.r2b.yaml", case: "threads=2" };
  assert.deepEqual(argumentsOf("r2bspec.smoke", about), [
    "run", "--smoke", "/robot/a.r2b.yaml", "--case", "threads=2",
  ]);
  assert.deepEqual(argumentsOf("r2bspec.recordInterfaces", { ...about, case: "" }), [
    "interfaces", "/robot/a.r2b.yaml",
  ]);
});
