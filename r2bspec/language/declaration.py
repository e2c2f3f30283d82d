"""How a key of the language is declared, and the rules that follow from the declarations.

The declaration of a key is a field of a `Record`: `r2bspec.language.spec` is the whole language.

    class Gate(Record, frozen=True, kw_only=True):
        '''How verdicts are reached. (And under 'Attributes' a sentence about each field.)'''

        time_budget: Annotated[Duration | None, key("10 min", positive=True)] = None

- The type says what is written: a text, a `Literal` of words, a number, a quantity with a unit, a
  list, a map of names, another record. A union is a choice between forms. `| None` is a key without
  a default. `Written` states another type where shorthands are read into the type of the field.
- The default is that of the field; a field without one is a required key.
- The docstring describes the key, and the record itself where it is an entry of a map or a list.
- Snippets of editors are in ``snippets.yaml``, by the name of a record or of its field.
- `key` states the rest: examples, limits, whether the value is a path, and what it changes: the
  load on the graph, the graph itself, or neither (`r2bspec.plan.comparability`). What a section
  says holds for its keys.
- A name in an annotation, such as `names.Topic`, brings its pattern with it.
- A `ClassVar` is a key that `Spec` does not have, because it is evaluated while a spec is loaded.
- `Record.from_word` and `Record.from_keys` expand shorthands: what one word means in place of the
  map, and what values make of the keys.

A `ValueRule` is the same as a value that can be asked. Everything else follows from rules, and
repeats nothing: the JSON Schema (`json_schema`), by which jsonschema accepts a document or finds
what is wrong (`structure`), the `Spec`, the tables of docs/language.md, completion and hover,
`--set`, the defaults that `explain` shows, which paths are moved with a file, and where references
may be.
"""

import re
import types
from collections.abc import Mapping, Sequence
from functools import cache, cached_property
from typing import Annotated, Any, ClassVar, Final, Literal, Union, get_args, get_origin

import msgspec

from r2bspec.diagnostics import Path
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.language.quantities import Quantity

Change = Literal["load", "graph", "neither"]
"""What a key changes: the load on the graph and its monitoring, the graph, or neither of them."""


class NamePattern(msgspec.Struct, frozen=True, dict=True):
    """A regular expression in the common subset of Python and JavaScript, with its texts.

    Attributes:
        noun: the name of such a text in messages.
        message: a description of the form.
    """

    pattern: str
    noun: str
    message: str

    def matches(self, text: str) -> bool:
        """Return whether a text has the form."""
        return re.search(self.exact, text) is not None

    @property
    def exact(self) -> str:
        """The pattern for Python, where '$' also matches before a line break at the end."""
        return self.pattern[:-1] + r"\Z" if self.pattern.endswith("$") else self.pattern


class Key(msgspec.Struct, frozen=True, eq=False, kw_only=True):
    """The declaration of a value, apart from its type.

    Attributes:
        examples: values as they are written, the most typical first.
        description: in place of the docstring.
        minimum: the minimum of a number.
        maximum: the maximum of a number.
        positive: whether a quantity must be more than zero.
        not_empty: whether a text must have a character.
        as_text: whether a number or a truth value stands for its text, as it is written.
        at_least: the fewest entries of a list or a map.
        at_most: the most entries of a list; or of a map, where the value is no list.
        words: the words that a text can be, where no `Literal` can list them.
        path: whether the text is a path, relative to the file in which it is written.
        topics: whether the keys of a map are topics, in which references are supported.
        loader: whether another step of loading evaluates the key.
        derived: whether no document has the key: other keys make the value.
        unless_live: whether the key is required unless the benchmark is live, or calls services.
        unless_calls: whether the key is required unless the benchmark calls services.
        default: of a key that is no field, as it is written.
        hidden_default: whether editors offer no default.
        changes: what the key changes, if that is not what its section says.
    """

    examples: tuple[Any, ...] = ()
    description: str = ""
    minimum: int | None = None
    maximum: int | None = None
    positive: bool = False
    not_empty: bool = False
    as_text: bool = False
    at_least: int = 0
    at_most: int = 0
    words: tuple[str, ...] = ()
    path: bool = False
    topics: bool = False
    loader: bool = False
    derived: bool = False
    unless_live: bool = False
    unless_calls: bool = False
    default: Any = None
    hidden_default: bool = False
    changes: Change | None = None


_NOTHING: Final = Key()


def key(*examples: Any, **rest: Any) -> Key:
    """Return a `Key` with its examples."""
    return Key(examples=examples, **rest)


class Written(msgspec.Struct, frozen=True):
    """The type of a key in documents, if the field has another type."""

    type: Any


class Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all values of the language: immutable, without unknown fields.

    Attributes:
        about: examples of the record.
        word: the type of the one word that may stand in place of the map; None for no such word.
    """

    about: ClassVar[Key] = _NOTHING
    word: ClassVar[Any] = None

    @classmethod
    def from_word(cls, word: str) -> Any:
        """Return the record that a word stands for, if it is written instead of the map."""
        raise NotImplementedError(f"{cls.__name__} is not written as a word")

    @classmethod
    def from_keys(cls, keys: dict[str, Any]) -> Any:
        """Return the record with these keys, named as fields; they may be changed."""
        return cls(**keys)

    @classmethod
    def fields_of(cls, value: "Record") -> dict[str, Any]:
        """Return the fields of this record in a record that extends it."""
        return {name: getattr(value, name) for name in cls.__struct_fields__}


class ValueRule(msgspec.Struct, eq=False, dict=True, kw_only=True):
    """The values that may be written at a place, and their description.

    Attributes:
        about: what its declaration says besides the type; `examples` are never empty but for Any.
        kinds: the types of JSON that it may have, in the order in which editors offer them; empty
            for any.
        pattern: the pattern of a text.
        words: the only texts that are allowed; of a quantity, texts besides it.
        const: the only value.
        quantity: the class that parses the text.
        items: the items of a list.
        keys: the keys of a map with known keys.
        names: the names of the keys of a map of named entries.
        values: the values of its entries.
        record: the class of a map with known keys.
        make: what a list becomes, `tuple` or `list`.
        default: the value without the key; UNSET if it is required, or no key at all.
        field: the name of the field, where the rule is that of a key.
        owner: the class that the field belongs to.
        loader: whether `Spec` does not have the key.
    """

    about: Key = _NOTHING
    kinds: tuple[str, ...] = ()
    pattern: NamePattern | None = None
    words: tuple[str, ...] = ()
    const: int | None = None
    quantity: type[Quantity] | type[Requirement] | None = None
    items: "ValueRule | None" = None
    keys: "dict[str, ValueRule] | None" = None
    names: NamePattern | None = None
    values: "ValueRule | None" = None
    record: type[Record] | None = None
    make: type = tuple
    default: Any = msgspec.UNSET
    field: str = ""
    owner: type[Record] | None = None
    loader: bool = False

    @cached_property
    def description(self) -> str:
        """The meaning of the value, for readers."""
        if self.about.description:
            return self.about.description
        if self.owner is not None and self.field in _texts(self.owner):
            return _texts(self.owner)[self.field]
        return _texts(self.record)[""] if self.record is not None else ""

    @cached_property
    def required(self) -> tuple[str, ...]:
        """The keys that a map must have."""
        return tuple(
            name
            for name, rule in (self.keys or {}).items()
            if rule.about.unless_live
            or rule.about.unless_calls
            or (not rule.loader and rule.is_required)
        )

    def required_unless(self, *, live: bool, calls: bool) -> tuple[str, ...]:
        """Return the required keys of a map in a live benchmark, or one that calls services."""
        about = {name: rule.about for name, rule in (self.keys or {}).items()}
        return tuple(
            name
            for name in self.required
            if not (live and about[name].unless_live) and not (calls and about[name].unless_calls)
        )

    @property
    def is_required(self) -> bool:
        """Whether the key has no default."""
        return self.default is msgspec.UNSET

    @cached_property
    def is_parsed(self) -> bool:
        """Whether the value is a text that a class parses, and nothing else."""
        return self.quantity is not None and self.kinds == ("string",)

    @property
    def is_choice(self) -> bool:
        """Whether the value is one of a few words, and nothing else."""
        return bool(self.words) and self.kinds == ("string",) and self.quantity is None

    @property
    def is_text(self) -> bool:
        """Whether the value is any text."""
        return self.kinds == ("string",) and self.quantity is None

    def below(self, step: str | int) -> "ValueRule | None":
        """Return the rule of an entry or an item; None if there is none."""
        if isinstance(step, int):
            return self.items
        return (self.keys or {}).get(step, self.values)

    @cached_property
    def shown_default(self) -> Any:
        """The default as it is written; None if there is none to show."""
        if self.about.default is not None:
            return self.about.default
        about = self.about
        if about.unless_live or about.unless_calls or about.at_least or about.hidden_default:
            return None
        return None if self.is_required else _written(self.default)

    @property
    def snippets(self) -> Sequence[Mapping[str, Any]]:
        """The proposals of editors: labels, and bodies with placeholders."""
        field = f"{self.owner.__name__}.{self.field}" if self.owner is not None else ""
        record = self.record.__name__ if self.record is not None else ""
        return _snippets().get(field) or _snippets().get(record, ())


def rule_of(annotation: Any) -> ValueRule:
    """Return the rule of a type, given as an annotation."""
    metadata: list[Any] = []
    while get_origin(annotation) in _WRAPPERS:
        metadata = [*getattr(annotation, "__metadata__", ()), *metadata]
        annotation = get_args(annotation)[0]
        written = next((nested for nested in metadata if isinstance(nested, Written)), None)
        if written is not None:
            metadata = [nested for nested in metadata if nested is not written]
            annotation = written.type
    rule = _rule_of_type(annotation)
    for item in metadata:
        if isinstance(item, NamePattern):
            rule.pattern = item
        elif isinstance(item, Key):
            rule.about = _merged(rule.about, item)
    rule.words = rule.about.words or rule.words
    if not rule.about.examples:
        rule.about = _merged(rule.about, Key(examples=_usual_examples(rule)))
    return rule


@cache
def record_keys(record: type[Record]) -> dict[str, ValueRule]:
    """Return the rules of the keys of a record, by their names in documents.

    Inherited keys come last.
    """
    names = dict(zip(record.__struct_fields__, record.__struct_encode_fields__, strict=True))
    last = record.__struct_fields__[-len(record.__struct_defaults__) or None :]
    defaults = dict(zip(last, record.__struct_defaults__, strict=record.__struct_defaults__ != ()))
    keys: dict[str, ValueRule] = {}
    declared = (
        (owner, field, annotation)
        for owner in record.__mro__
        if issubclass(owner, Record) and owner is not Record
        for field, annotation in owner.__annotations__.items()
    )
    for owner, field, annotation in declared:
        rule = rule_of(annotation)
        if rule.about.derived:
            continue
        default = defaults.get(field, msgspec.NODEFAULT)
        default = msgspec.UNSET if default is msgspec.NODEFAULT else default
        rule.default = default.factory() if hasattr(default, "factory") else default
        rule.field, rule.owner, rule.loader = field, owner, field not in names
        if rule.about.examples == () and rule.kinds == ("boolean",):
            rule.about = _merged(rule.about, Key(examples=(not rule.default,)))
        keys[names.get(field, field)] = rule
    return keys


@cache
def language() -> ValueRule:
    """Return the rule of a whole document."""
    from r2bspec.language.spec import Spec

    return rule_of(Spec)


def rule_at(path: Path) -> ValueRule | None:
    """Return the rule of the value at a path; None if the language has no such path."""
    rule: ValueRule | None = language()
    for step in path:
        rule = rule.below(step) if rule is not None else None
    return rule


def change_at(path: Path) -> Change:
    """Return what the key at a path changes, as it or its nearest section declares.

    Raises:
        KeyError: neither says anything, or the language has no such path.
    """
    for length in range(len(path), 0, -1):
        rule = rule_at(path[:length])
        if rule is not None and rule.about.changes is not None:
            return rule.about.changes
    raise KeyError(path)


_WRAPPERS: Final[tuple[Any, ...]] = (ClassVar, Annotated)
_SCALARS: Final = frozenset({bool, int, float, str})
_KINDS: Final = {str: "string", int: "integer", bool: "boolean", float: "number"}


def _rule_of_type(kind: Any) -> ValueRule:
    origin = get_origin(kind)
    if origin in (Union, types.UnionType):
        return _rule_of_union(get_args(kind))
    if origin is Literal:
        words = get_args(kind)
        if isinstance(words[0], int):
            return ValueRule(kinds=("integer",), const=words[0])
        return ValueRule(kinds=("string",), words=words)
    if origin in (tuple, list):
        return ValueRule(kinds=("array",), items=rule_of(get_args(kind)[0]), make=origin)
    if origin is dict:
        names, values = (rule_of(arg) for arg in get_args(kind))
        return ValueRule(kinds=("object",), names=names.pattern, values=values)
    if kind is Any:
        return ValueRule()
    if issubclass(kind, Record):
        rule = ValueRule(kinds=("object",), keys=record_keys(kind), record=kind, about=kind.about)
        return rule if kind.word is None else _joined([rule_of(kind.word), rule], about=kind.about)
    if issubclass(kind, Quantity | Requirement):
        return ValueRule(kinds=("string",), quantity=kind)
    return ValueRule(kinds=(_KINDS[kind],))


def _rule_of_union(members: Sequence[Any]) -> ValueRule:
    """Return the rule of one of several forms.

    Text, numbers and truth values together are one form.
    """
    forms = [member for member in members if member is not types.NoneType]
    if len(forms) == 1:
        return rule_of(forms[0])
    rules = [rule_of(form) for form in forms if form not in _SCALARS]
    if _SCALARS.intersection(forms):
        rules.insert(0, ValueRule(kinds=("string", "number", "boolean")))
    return rules[0] if len(rules) == 1 else _joined(rules)


def _joined(rules: Sequence[ValueRule], about: Key | None = None) -> ValueRule:
    """Return one rule for several forms, which have different types of JSON."""
    joined = ValueRule()
    for rule in rules:
        joined.kinds = tuple(dict.fromkeys((*joined.kinds, *rule.kinds)))
        joined.about = _merged(joined.about, msgspec.structs.replace(rule.about, description=""))
        for name in ("pattern", "words", "quantity", "items", "keys", "names", "values", "record"):
            if getattr(rule, name):
                setattr(joined, name, getattr(rule, name))
        if rule.items is not None:
            joined.make = rule.make
    if about is not None:
        joined.about = _merged(joined.about, about)
    return joined


def _merged(first: Key, second: Key) -> Key:
    """Return both, of which the second has precedence."""
    if first is _NOTHING:
        return second
    said = {
        name: getattr(second, name)
        for name in Key.__struct_fields__
        if getattr(second, name) != getattr(_NOTHING, name)
    }
    return msgspec.structs.replace(first, **said)


def _usual_examples(rule: ValueRule) -> tuple[Any, ...]:
    if rule.words:
        return rule.words[:1]
    if rule.const is not None:
        return (rule.const,)
    if rule.quantity is not None and issubclass(rule.quantity, Quantity):
        return (rule.quantity.example,)
    return ()


def _written(value: Any) -> Any:
    """Return a default as it would be written; None for one that is nothing."""
    if isinstance(value, Quantity):
        return str(value)
    if isinstance(value, Record):
        return {}
    if isinstance(value, tuple):
        return []
    return None if isinstance(value, str) and not value else value


@cache
def _snippets() -> Mapping[str, Sequence[Mapping[str, Any]]]:
    """Return the snippets of records and of their fields, by name."""
    from importlib.resources import files

    import yaml

    text = files(__package__).joinpath("snippets.yaml").read_text(encoding="utf-8")
    snippets: Mapping[str, Sequence[Mapping[str, Any]]] = yaml.safe_load(text)
    return snippets


@cache
def _texts(record: type[Record]) -> Mapping[str, str]:
    """Return the descriptions of a record's fields by name, and of the record under ''."""
    # Not for those who only load a spec: it takes as long to import as all of the language.
    import inspect

    summary, _, fields = inspect.cleandoc(record.__doc__ or "").partition("\n\nAttributes:\n")
    texts = {"": " ".join(summary.split("\n\n")[0].split())}
    for part in re.split(r"\n(?=    \w)", fields):
        name, _, text = part.strip().partition(": ")
        texts[name] = " ".join(text.split())
    return texts


def encode_text(value: object) -> str:
    """Encode a quantity, a requirement or a condition as text: the `enc_hook` of msgspec."""
    if isinstance(value, Quantity | Requirement):
        return str(value)
    raise NotImplementedError(f"cannot write {type(value).__name__}")


def decode_text(kind: type, value: object) -> Any:
    """Decode the text of `encode_text`: the `dec_hook` of msgspec.

    Raises:
        QuantityError: the text is not a quantity of that kind.
        ComparisonError: the text is not a requirement, or not a condition.
    """
    if isinstance(value, kind):
        return value
    if isinstance(value, str) and issubclass(kind, Quantity | Requirement):
        return kind.parse(value)
    raise NotImplementedError(f"cannot read a {kind.__name__} from {type(value).__name__}")
