/** Starts r2bspec: in a process whose output is wanted, or in a task that shows it. */

import { spawn } from "node:child_process";
import { existsSync } from "node:fs";
import { isAbsolute, join } from "node:path";
import * as vscode from "vscode";
import { findCommand, withSetup } from "./commandLine";

export interface Finished {
  /** The exit status; null if a signal ended the process. */
  readonly status: number | null;
  readonly output: string;
  readonly errors: string;
}

/** The folder in which runs are started: the first one of the workspace. */
export function folder(): string {
  return vscode.workspace.workspaceFolders?.[0]?.uri.fsPath ?? process.cwd();
}

/** The words of a command line of r2bspec, in the environment of the workspace. */
export async function commandLine(words: readonly string[]): Promise<string[]> {
  const settings = vscode.workspace.getConfiguration("r2bspec");
  const setupFiles = settings
    .get<string[]>("setupFiles", [])
    .map((each) => (isAbsolute(each) ? each : join(folder(), each)));
  const command = settings.get<string[]>("command", []);
  const interpreter = command.length > 0 ? "" : await selectedInterpreter();
  const found = findCommand({ command, setupFiles, interpreter, folder: folder() }, existsSync);
  return withSetup([...found, ...words], setupFiles);
}

/** The part of the Python extension's interface that is used. */
interface PythonExtension {
  readonly environments?: {
    getActiveEnvironmentPath(resource?: vscode.Uri): { readonly path: string };
  };
}

async function selectedInterpreter(): Promise<string> {
  const extension = vscode.extensions.getExtension<PythonExtension>("ms-python.python");
  const python = await extension?.activate();
  return python?.environments?.getActiveEnvironmentPath()?.path ?? "";
}

/** Run r2bspec to its end. A cancelled one is ended as with Ctrl-C, which ends a run in order. */
export async function run(
  words: readonly string[],
  onProgress: (text: string) => void = () => undefined,
  cancelled?: vscode.CancellationToken,
): Promise<Finished> {
  const [program, ...rest] = await commandLine(words);
  return new Promise((resolve) => {
    const child = spawn(program ?? "r2bspec", rest, {
      cwd: folder(),
      stdio: ["ignore", "pipe", "pipe"],
    });
    let output = "";
    let errors = "";
    child.stdout.setEncoding("utf8").on("data", (text: string) => (output += text));
    child.stderr.setEncoding("utf8").on("data", (text: string) => {
      errors += text;
      onProgress(text);
    });
    const stop = cancelled?.onCancellationRequested(() => child.kill("SIGINT"));
    const end = (status: number | null, error = ""): void => {
      stop?.dispose();
      resolve({ status, output, errors: errors + error });
    };
    child.on("error", (error) => end(null, error.message));
    child.on("close", (status) => end(status));
  });
}

/** A task that runs r2bspec in a terminal; its findings are shown as problems. */
export async function task(title: string, words: readonly string[]): Promise<vscode.Task> {
  const [program, ...rest] = await commandLine(words);
  const made = new vscode.Task(
    { type: "r2bspec", arguments: [...words] },
    vscode.workspace.workspaceFolders?.[0] ?? vscode.TaskScope.Workspace,
    title,
    "r2bspec",
    new vscode.ProcessExecution(program ?? "r2bspec", rest, { cwd: folder() }),
    "$r2bspec",
  );
  made.presentationOptions = { reveal: vscode.TaskRevealKind.Always, clear: true };
  return made;
}
