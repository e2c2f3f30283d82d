/** The extension: the language server, its commands, the test explorer and the task. */

import * as vscode from "vscode";
import { VERBS } from "./commandLine";
import { Pages } from "./pages";
import { task } from "./processes";
import { Server } from "./server";
import { carryOut } from "./specCommands";
import { TestExplorer } from "./testExplorer";

export async function activate(context: vscode.ExtensionContext): Promise<void> {
  const pages = new Pages();
  const server = new Server();
  const tests = new TestExplorer(server);
  const restart = async (): Promise<void> => {
    await server.start();
    await tests.discover();
  };
  context.subscriptions.push(
    server,
    tests,
    vscode.commands.registerCommand("r2bspec.restartServer", restart),
    ...Object.keys(VERBS).map((name) =>
      vscode.commands.registerCommand(name, () => carryOut(name, pages, (uri) => server.cases(uri))),
    ),
    vscode.tasks.registerTaskProvider("r2bspec", {
      provideTasks: async () => [await task("validate all specs", ["validate", "."])],
      resolveTask: (given) => resolved(given),
    }),
    vscode.workspace.onDidSaveTextDocument((document) =>
      document.languageId === "r2bspec" ? pages.refresh() : undefined,
    ),
    vscode.workspace.onDidChangeConfiguration((change) =>
      change.affectsConfiguration("r2bspec") ? restart() : undefined,
    ),
  );
  await restart();
}

/** A task of a tasks.json, with the command line of this workspace. */
async function resolved(given: vscode.Task): Promise<vscode.Task | undefined> {
  const words: unknown = given.definition["arguments"];
  if (!Array.isArray(words)) {
    return undefined;
  }
  const made = await task(given.name, words.map(String));
  // The editor compares the definitions by identity.
  made.definition = given.definition;
  return made;
}
