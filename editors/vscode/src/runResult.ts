/** What a run says about its case, from its exit status and its result. No editor is needed here. */

export type Outcome = "passed" | "failed" | "errored";

export interface CaseResult {
  readonly outcome: Outcome;
  /** What to read, one message for each requirement that is not met. */
  readonly messages: readonly string[];
}

interface Requirement {
  readonly objective: string;
  readonly text: string;
  readonly outcome: string;
  readonly reason: string;
}

interface Result {
  readonly verdict: {
    readonly reason: string;
    readonly requirements: readonly Requirement[];
  };
}

/** The exit statuses of r2bspec that are an answer about the requirements. */
const PASSED = 0;
const FAILED = 1;
const INCONCLUSIVE = 3;

/**
 * The result of `r2bspec run --format json`.
 *
 * @param status its exit status; null if a signal ended it.
 * @param output its standard output.
 * @param progress its standard error, which has the reason of a run that could not be made.
 */
export function caseResult(status: number | null, output: string, progress: string): CaseResult {
  if (status === PASSED) {
    return { outcome: "passed", messages: [] };
  }
  const result = parsed(output);
  if (result === undefined || (status !== FAILED && status !== INCONCLUSIVE)) {
    const reason = progress.trim() || `r2bspec ended with status ${status ?? "unknown"}`;
    return { outcome: "errored", messages: [result?.verdict.reason || reason] };
  }
  const unmet = result.verdict.requirements.filter((each) => each.outcome !== "pass");
  const messages = unmet.map(
    (each) => `${each.objective}: ${each.text}: ${each.outcome}. ${each.reason}`,
  );
  return {
    // The explorer has no word for inconclusive; it is no failure of the graph.
    outcome: status === FAILED ? "failed" : "errored",
    messages: messages.length > 0 ? messages : [result.verdict.reason],
  };
}

function parsed(output: string): Result | undefined {
  try {
    const found = JSON.parse(output) as Partial<Result> | null;
    return Array.isArray(found?.verdict?.requirements) ? (found as Result) : undefined;
  } catch {
    return undefined;
  }
}
