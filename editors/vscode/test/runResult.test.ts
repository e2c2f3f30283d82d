import assert from "node:assert/strict";
import { test } from "node:test";
import { caseResult } from "../src/runResult";

const RESULT = JSON.stringify({
  verdict: {
    reason: "1 of 2 requirements failed.",
    requirements: [
      { objective: "fast", text: "latency.p50 < 5 ms", outcome: "fail", reason: "It is 12 ms." },
      { objective: "fast", text: "drop_rate <= 1 %", outcome: "pass", reason: "None is missed." },
    ],
  },
});

test("a run that passes says nothing", () => {
  assert.deepEqual(caseResult(0, RESULT, ""), { outcome: "passed", messages: [] });
});

test("each requirement that is not met is a message", () => {
  const found = caseResult(1, RESULT, "progress");
  assert.equal(found.outcome, "failed");
  assert.deepEqual(found.messages, ["fast: latency.p50 < 5 ms: fail. It is 12 ms."]);
});

test("an inconclusive run is no failure", () => {
  assert.equal(caseResult(3, RESULT.replace('"fail"', '"inconclusive"'), "").outcome, "errored");
});

test("a run that could not be made says why", () => {
  const found = caseResult(2, "", "error: no such file\n");
  assert.deepEqual(found, { outcome: "errored", messages: ["error: no such file"] });
  assert.deepEqual(caseResult(null, "{}", "").messages, ["r2bspec ended with status unknown"]);
});
