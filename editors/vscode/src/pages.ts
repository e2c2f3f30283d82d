/** Pages that r2bspec writes, in panels of the editor. */

import * as vscode from "vscode";
import { run } from "./processes";

interface Page {
  readonly panel: vscode.WebviewPanel;
  /** What prints it. */
  readonly words: readonly string[];
  /** Whether it is printed again when a file is saved. */
  readonly live: boolean;
}

/** The panels that are open. No script of a page runs: what it says can be read without. */
export class Pages {
  private readonly pages = new Map<string, Page>();

  /** Show what r2bspec prints for these words; the panel of the same words is used again. */
  async show(title: string, words: readonly string[], { live = false } = {}): Promise<void> {
    const finished = await run(words);
    if (finished.status !== 0) {
      void vscode.window.showErrorMessage(`r2bspec: ${finished.errors.trim() || finished.output}`);
      return;
    }
    const key = words.join("\0");
    const page = this.pages.get(key) ?? { panel: this.panel(key, title), words, live };
    this.pages.set(key, page);
    page.panel.webview.html = finished.output;
    page.panel.reveal(undefined, true);
  }

  /** Print the live pages again, of a spec that has changed; one with errors keeps its last page. */
  async refresh(): Promise<void> {
    for (const page of [...this.pages.values()].filter((each) => each.live)) {
      const finished = await run(page.words);
      if (finished.status === 0) {
        page.panel.webview.html = finished.output;
      }
    }
  }

  private panel(key: string, title: string): vscode.WebviewPanel {
    const panel = vscode.window.createWebviewPanel(
      "r2bspec.page",
      title,
      { viewColumn: vscode.ViewColumn.Beside, preserveFocus: true },
      { enableScripts: false, localResourceRoots: [], enableFindWidget: true },
    );
    panel.onDidDispose(() => this.pages.delete(key));
    return panel;
  }
}
