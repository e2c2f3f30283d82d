/** The commands about the spec in the editor: each is a command line, whose output gets a place to be seen. */

import { basename } from "node:path";
import * as vscode from "vscode";
import { argumentsOf, type SpecCommand } from "./commandLine";
import type { Pages } from "./pages";
import { run, task } from "./processes";
import type { SpecCase } from "./server";

/** Tells the cases of a spec. */
export type CasesOf = (uri: vscode.Uri) => Promise<readonly SpecCase[]>;

/** Carry out a command; nothing is done without a spec. */
export async function carryOut(
  name: string,
  pages: Pages,
  casesOf: CasesOf,
): Promise<void> {
  const about = await openSpec(casesOf);
  if (about === undefined) {
    return;
  }
  const words = argumentsOf(name, about);
  // The command line reads files.
  await vscode.workspace.saveAll(false);
  const title = [basename(about.file), about.case].filter(Boolean).join(" ");
  switch (name) {
    case "r2bspec.drawGraph":
      await pages.show(`Graph of ${title}`, words, { live: true });
      break;
    case "r2bspec.plan":
      await showPlan(words);
      break;
    default:
      await vscode.tasks.executeTask(await task(`${words[0]} ${title}`, words));
  }
}

/** The spec in the editor, for a command of the palette; of several cases the one that is picked. */
async function openSpec(casesOf: CasesOf): Promise<SpecCommand | undefined> {
  const document = vscode.window.activeTextEditor?.document;
  if (document?.languageId !== "r2bspec") {
    return undefined;
  }
  const names = (await casesOf(document.uri)).map((each) => each.case);
  const picked = names.length > 1 ? await vscode.window.showQuickPick(names) : names[0];
  return picked === undefined ? undefined : { file: document.uri.fsPath, case: picked };
}

async function showPlan(words: readonly string[]): Promise<void> {
  const finished = await run(words);
  if (finished.status !== 0) {
    void vscode.window.showErrorMessage(`r2bspec: ${finished.errors.trim() || finished.output}`);
    return;
  }
  const plan = await vscode.workspace.openTextDocument({
    language: "json",
    content: `${JSON.stringify(JSON.parse(finished.output), undefined, 2)}\n`,
  });
  await vscode.window.showTextDocument(plan, { viewColumn: vscode.ViewColumn.Beside });
}
