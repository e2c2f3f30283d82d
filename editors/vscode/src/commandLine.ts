/** The words that start r2bspec, in the environment of the workspace. No editor is needed here. */

/** What the settings and the workspace say about r2bspec. */
export interface Installation {
  /** The setting r2bspec.command; empty to search. */
  readonly command: readonly string[];
  /** Files that bash sources first, absolute. */
  readonly setupFiles: readonly string[];
  /** The interpreter that the Python extension has selected; empty without one. */
  readonly interpreter: string;
  /** The first folder of the workspace. */
  readonly folder: string;
}

/** What a command is about: a spec, and one of its cases. */
export interface SpecCommand {
  readonly file: string;
  readonly case?: string;
}

/**
 * The words that start r2bspec.
 *
 * @param exists tells whether there is a file of this path.
 */
export function findCommand(at: Installation, exists: (path: string) => boolean): string[] {
  if (at.command.length > 0) {
    return [...at.command];
  }
  const beside = at.interpreter.replace(/[^/\\]*$/, "r2bspec");
  const found = [at.interpreter ? beside : "", `${at.folder}/.venv/bin/r2bspec`].find(
    (each) => each !== "" && exists(each),
  );
  return [found ?? "r2bspec"];
}

/** The words of a program that starts after bash has sourced the setup files. */
export function withSetup(words: readonly string[], setupFiles: readonly string[]): string[] {
  if (setupFiles.length === 0) {
    return [...words];
  }
  // What a setup file prints must not get into the protocol of the server.
  const sourced = setupFiles.map((each) => `. ${quoted(each)} >&2`);
  return ["bash", "-c", [...sourced, `exec ${words.map(quoted).join(" ")}`].join(" && ")];
}

/** A word for a shell. */
export function quoted(word: string): string {
  return `'${word.replaceAll("'", "'\\''")}'`;
}

/** The commands about a spec, by their names in the palette. */
export const VERBS: Readonly<Record<string, readonly string[]>> = {
  "r2bspec.run": ["run"],
  "r2bspec.smoke": ["run", "--smoke"],
  "r2bspec.plan": ["plan"],
  "r2bspec.drawGraph": ["plan", "--graph", "html"],
  "r2bspec.recordInterfaces": ["interfaces"],
};

/** What follows r2bspec for a command of `VERBS`. */
export function argumentsOf(name: string, about: SpecCommand): string[] {
  const verb = VERBS[name] ?? [];
  return [...verb, about.file, ...(about.case ? ["--case", about.case] : [])];
}
