/** Specs in the test explorer: each case is a test, and its run is the test's result. */

import * as vscode from "vscode";
import { argumentsOf } from "./commandLine";
import { run } from "./processes";
import { caseResult } from "./runResult";
import type { Server } from "./server";

const SPECS = "**/*.r2b.{yaml,yml}";
const NOT_SPECS = "**/{node_modules,.venv,runs,build,install,log}/**";

/** The tests of the workspace. */
export class TestExplorer implements vscode.Disposable {
  private readonly controller = vscode.tests.createTestController("r2bspec", "r2bspec");
  private readonly watcher = vscode.workspace.createFileSystemWatcher(SPECS);
  /** The argument of --case, for the items that can be run. */
  private readonly cases = new WeakMap<vscode.TestItem, string>();

  constructor(private readonly server: Server) {
    this.controller.refreshHandler = () => this.discover();
    this.addProfile("Run", "r2bspec.run", true);
    this.addProfile("Smoke run", "r2bspec.smoke", false);
    this.watcher.onDidCreate((uri) => this.update(uri));
    this.watcher.onDidChange((uri) => this.update(uri));
    this.watcher.onDidDelete((uri) => this.controller.items.delete(uri.toString()));
  }

  /** Find all specs of the workspace. */
  async discover(): Promise<void> {
    const found = await vscode.workspace.findFiles(SPECS, NOT_SPECS);
    const ids = new Set(found.map(String));
    const gone = [...this.controller.items].map(([id]) => id).filter((id) => !ids.has(id));
    gone.forEach((id) => this.controller.items.delete(id));
    for (const uri of found) {
      await this.update(uri);
    }
  }

  dispose(): void {
    this.watcher.dispose();
    this.controller.dispose();
  }

  private async update(uri: vscode.Uri): Promise<void> {
    const cases = await this.server.cases(uri);
    const label = vscode.workspace.asRelativePath(uri);
    const file = this.controller.createTestItem(uri.toString(), label, uri);
    const items = cases.map((each) => {
      const item = this.controller.createTestItem(`${uri.toString()}#${each.name}`, each.name, uri);
      item.range = new vscode.Range(each.line, 0, each.line, 0);
      this.cases.set(item, each.case);
      return item;
    });
    file.children.replace(items);
    this.controller.items.add(file);
  }

  private addProfile(label: string, command: string, isDefault: boolean): void {
    this.controller.createRunProfile(
      label,
      vscode.TestRunProfileKind.Run,
      (request, cancelled) => this.runAll(request, cancelled, command),
      isDefault,
    );
  }

  /** Run the cases one after the other: two at once would disturb each other's measurement. */
  private async runAll(
    request: vscode.TestRunRequest,
    cancelled: vscode.CancellationToken,
    command: string,
  ): Promise<void> {
    const excluded = new Set(request.exclude ?? []);
    const chosen = request.include ?? [...this.controller.items].map(([, item]) => item);
    const items = [...new Set(chosen.flatMap((item) => this.leaves(item, excluded)))];
    const testRun = this.controller.createTestRun(request);
    items.forEach((item) => testRun.enqueued(item));
    for (const item of items) {
      if (cancelled.isCancellationRequested) {
        testRun.skipped(item);
      } else {
        await this.runCase(item, testRun, cancelled, command);
      }
    }
    testRun.end();
  }

  private leaves(item: vscode.TestItem, excluded: ReadonlySet<vscode.TestItem>): vscode.TestItem[] {
    if (excluded.has(item)) {
      return [];
    }
    return item.children.size === 0
      ? [item]
      : [...item.children].flatMap(([, child]) => this.leaves(child, excluded));
  }

  private async runCase(
    item: vscode.TestItem,
    testRun: vscode.TestRun,
    cancelled: vscode.CancellationToken,
    command: string,
  ): Promise<void> {
    const about = { file: item.uri?.fsPath ?? "", case: this.cases.get(item) ?? "" };
    const words = [...(argumentsOf(command, about) ?? []), "--format", "json"];
    const began = Date.now();
    testRun.started(item);
    const finished = await run(
      words,
      // The view of the output is a terminal, which wants both characters.
      (text) => testRun.appendOutput(text.replaceAll(/\r?\n/g, "\r\n"), undefined, item),
      cancelled,
    );
    if (cancelled.isCancellationRequested) {
      testRun.skipped(item);
      return;
    }
    const result = caseResult(finished.status, finished.output, finished.errors);
    const messages = result.messages.map((text) => messageAt(item, text));
    const took = Date.now() - began;
    switch (result.outcome) {
      case "passed":
        testRun.passed(item, took);
        break;
      case "failed":
        testRun.failed(item, messages, took);
        break;
      case "errored":
        testRun.errored(item, messages, took);
    }
  }
}

function messageAt(item: vscode.TestItem, text: string): vscode.TestMessage {
  const message = new vscode.TestMessage(text);
  if (item.uri !== undefined && item.range !== undefined) {
    message.location = new vscode.Location(item.uri, item.range);
  }
  return message;
}
