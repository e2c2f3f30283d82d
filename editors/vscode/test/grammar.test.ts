/**
 * The grammars, tokenized by the library of VS Code together with a grammar of YAML.
 *
 * The one on npm is older than that of VS Code: it takes the first character of a plain text for
 * itself, so that what begins a plain text is not compared here.
 */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import * as oniguruma from "vscode-oniguruma";
import * as textmate from "vscode-textmate";

const ROOT = join(__dirname, "..", "..");
const YAML = join(ROOT, "node_modules", "tm-grammars", "grammars");
const FILES: Readonly<Record<string, string>> = {
  "source.r2bspec": join(ROOT, "syntaxes", "r2bspec.tmLanguage.json"),
  "r2bspec.values": join(ROOT, "syntaxes", "values.tmLanguage.json"),
  "source.yaml": join(YAML, "yaml.json"),
};

async function grammar(): Promise<textmate.IGrammar> {
  const wasm = readFileSync(require.resolve("vscode-oniguruma/release/onig.wasm"));
  await oniguruma.loadWASM(new Uint8Array(wasm).buffer);
  const registry = new textmate.Registry({
    onigLib: Promise.resolve({
      createOnigScanner: (sources) => new oniguruma.OnigScanner(sources),
      createOnigString: (text) => new oniguruma.OnigString(text),
    }),
    loadGrammar: (scope) => {
      const file = FILES[scope];
      return Promise.resolve(
        file === undefined ? null : textmate.parseRawGrammar(readFileSync(file, "utf8"), file),
      );
    },
    getInjections: (scope) => (scope === "source.r2bspec" ? ["r2bspec.values"] : undefined),
  });
  const found = await registry.loadGrammar("source.r2bspec");
  assert.ok(found);
  return found;
}

let loaded: Promise<textmate.IGrammar> | undefined;

/** The innermost scope of each text of a document that has one of r2bspec. */
async function named(document: string): Promise<Record<string, string>> {
  loaded ??= grammar();
  const found: Record<string, string> = {};
  let state = textmate.INITIAL;
  for (const line of document.split("\n")) {
    const result = (await loaded).tokenizeLine(line, state);
    state = result.ruleStack;
    for (const token of result.tokens) {
      const scope = token.scopes.at(-1) ?? "";
      if (scope.endsWith(".r2bspec") && !scope.startsWith("source.")) {
        found[line.slice(token.startIndex, token.endIndex).trim()] = scope;
      }
    }
  }
  return found;
}

test("requirements have parts, plain and in quotes", async () => {
  for (const quote of ["", '"', "'"]) {
    const found = await named(`require:\n  - ${quote}out.latency.p99 <= 12.5 ms${quote}`);
    const metric = quote === "" ? "ut.latency.p99" : "out.latency.p99";
    assert.equal(found[metric], "support.function.metric.r2bspec");
    assert.equal(found["<="], "keyword.operator.comparison.r2bspec");
    assert.equal(found["12.5"], "constant.numeric.r2bspec");
    assert.equal(found["ms"], "keyword.other.unit.r2bspec");
  }
});

test("a share of the offered rate", async () => {
  const found = await named("require: [throughput.mean >= 97 % of offered, 'drop_rate < 1 %']");
  assert.equal(found["%"], "keyword.other.unit.r2bspec");
  assert.equal(found["offered"], "variable.language.r2bspec");
  assert.equal(found["drop_rate"], "support.function.metric.r2bspec");
});

test("references are seen wherever a text is", async () => {
  for (const line of ["rates: ['$(var rate)']", "title: at $(var rate)", 'x: "a $(var rate) b"']) {
    assert.equal((await named(line))["rate"], "variable.other.r2bspec", line);
  }
});

test("comments, keys and other texts stay YAML", async () => {
  const found = await named(
    "# latency.p99 < 5 ms of $(var rate)\nformat: sensor_msgs/msg/Image\na.b: 3",
  );
  assert.deepEqual(found, {});
});
