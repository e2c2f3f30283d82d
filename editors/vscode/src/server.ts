/** The language server of the workspace. */

import * as vscode from "vscode";
import { LanguageClient, type LanguageClientOptions } from "vscode-languageclient/node";
import { commandLine, folder } from "./processes";

/** One case of a spec, as the server tells it. */
export interface SpecCase {
  readonly name: string;
  /** As --case takes it; empty for a spec without a matrix. */
  readonly case: string;
  /** From 0. */
  readonly line: number;
}

/** The server; it can be started again, in another environment. */
export class Server implements vscode.Disposable {
  private client: LanguageClient | undefined;

  async start(): Promise<void> {
    await this.client?.dispose();
    const [command, ...args] = await commandLine(["lsp"]);
    this.client = new LanguageClient(
      "r2bspec",
      "r2bspec",
      { command: command ?? "r2bspec", args, options: { cwd: folder() } },
      options(),
    );
    try {
      await this.client.start();
    } catch (error) {
      const hint = "Set r2bspec.command, or install it: pip install 'r2bspec[editor]'.";
      void vscode.window.showErrorMessage(`r2bspec does not start: ${String(error)}. ${hint}`);
    }
  }

  /** The cases of a spec, open or not; none if the server does not run. */
  async cases(uri: vscode.Uri): Promise<readonly SpecCase[]> {
    if (this.client?.isRunning() !== true) {
      return [];
    }
    return this.client.sendRequest<SpecCase[]>("r2bspec/cases", { uri: uri.toString() });
  }

  dispose(): void {
    void this.client?.dispose();
  }
}

function options(): LanguageClientOptions {
  return {
    documentSelector: [
      { scheme: "file", language: "r2bspec" },
      // Files that specs extend, and files of interfaces and parameters.
      { scheme: "file", language: "yaml" },
    ],
    synchronize: {
      fileEvents: [vscode.workspace.createFileSystemWatcher("**/*.{yaml,yml,py}")],
    },
  };
}
