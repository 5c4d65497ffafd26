"""Plain-text equations of docstrings, as `M = gain (h x B) / |B|^2`, as LaTeX."""

from __future__ import annotations

import re

GREEK = {
    "alpha",
    "beta",
    "gamma",
    "delta",
    "epsilon",
    "theta",
    "lambda",
    "mu",
    "nu",
    "xi",
    "pi",
    "rho",
    "sigma",
    "tau",
    "phi",
    "psi",
    "omega",
    "Omega",
    "Gamma",
    "Delta",
}
FUNCTIONS = ("exp", "sin", "cos", "tan", "tanh", "min", "max", "det")
OPERATORS = ("atan2", "clip", "unit", "sgn", "sign", "diag", "friction", "mean")
SIGNS = {
    "=": "=",
    "<=": r"\le",
    ">=": r"\ge",
    "<": "<",
    ">": ">",
    "+": "+",
    "-": "-",
    "+-": r"\pm",
    "-+": r"\mp",
    "+=": r"\mathrel{+}=",
    "<-": r"\leftarrow",
    ",": r",\;",
    ";": r";\;",
    "in": r"\in",
}
TOKEN = re.compile(
    r"(?P<space> +)|(?P<kron>\(x\))|(?P<tight>/(?! ))|(?P<sign><=|>=|\+=|<-|\+-|-\+|[=<>+\-,;])"
    r"|(?P<code>`\w+`)|(?P<words>on-time)"
    r"|(?P<name>[A-Za-z](?:\w*[A-Za-z0-9])?(?::\d|,[a-z]\b)?|_)|(?P<number>\d+(?:\.\d+)?(?:e-?\d+)?)"
    r"|(?P<open>[(\[])|(?P<close>[)\]])|(?P<bar>\|)|(?P<power>\^)|(?P<prime>'+)|(?P<over>/)"
    r"|(?P<dot>\.)"
)
WORDS = re.compile(
    r"(?:(?:^|,? )(?:each|where|while|until|about|within|at most|over|the thrusters|of one|of an"
    r"|for|with a|along|or|and every)\b|  +\((?:eqs?\.|Table|gain in|hold\)|paper \d+|u to)).*$"
)
LABEL = re.compile(r"^([a-z_][a-z_ -]*):  *(?=\S)")


class NoEquationError(ValueError):
    """The text does not parse."""


def block(lines: list[str]) -> str | None:
    """The LaTeX of an indented block, a row each statement; None where a line does not
    parse."""
    rows = []
    try:
        for line in lines:
            for part in re.split(r"(?<=\S)  +(?=[a-z]+:  )", line):
                rows += _rows(part.rstrip())
    except NoEquationError:
        return None
    return "\\begin{array}{l}\n" + " \\\\[4pt]\n".join(rows) + "\n\\end{array}"


def _rows(line: str) -> list[str]:
    """The rows of a line: statements stand apart by two spaces or more."""
    depth = len(line) - len(line.lstrip())
    line = line.strip()
    label = LABEL.match(line)
    head = rf"\text{{{_text(label[1])}:}}\quad " if label else ""
    rows = []
    for part in re.split(
        r"[,;]?  +(?=[^\s(=])", line[label.end() :] if label else line
    ):
        words = WORDS.search(part)
        equation_part = part[: words.start()] if words else part
        row = r"\quad " if depth or part.startswith(("+ ", "- ")) else ""
        row += _Parser(equation_part).parse()
        if words:
            row += (
                r"\quad " if equation_part.strip() else ""
            ) + rf"\text{{{_text(words[0].strip(' ,'))}}}"
        rows.append(r"\displaystyle " + head + row)
        head = ""
    return rows


def _text(words: str) -> str:
    """Words within \text, where an underscore is no sign of TeX."""
    return re.sub(r" +", " ", words.replace("`", "")).replace("+-", "±")


class _Parser:
    """Recursive descent: what stands before a spaced `/` within a term is its
    numerator, one factor after it the denominator; `/` without spaces binds its two
    neighbours alone."""

    def __init__(self, text: str) -> None:
        self.tokens: list[tuple[str, str]] = []
        at = 0
        text = text.strip().rstrip(",;.").replace("integral of ", "integral ")
        while at < len(text):
            found = TOKEN.match(text, at)
            if not found:
                raise NoEquationError(text[at:])
            self.tokens.append((str(found.lastgroup), found[0]))
            at = found.end()
        self.at = 0
        self.bars = 0

    def parse(self) -> str:
        latex = self.sequence()
        if self.at < len(self.tokens):
            raise NoEquationError(str(self.tokens[self.at :]))
        return latex

    def peek(self, skip: bool = False) -> tuple[str, str]:
        i = self.at
        while skip and i < len(self.tokens) and self.tokens[i][0] == "space":
            i += 1
        return self.tokens[i] if i < len(self.tokens) else ("end", "")

    def take(self) -> tuple[str, str]:
        token = self.peek()
        self.at += 1
        return token

    def sequence(self) -> str:
        """Terms and signs up to a closing bracket, bar or the end."""
        latex: list[str] = []
        while True:
            kind, text = self.peek(skip=True)
            if kind in ("end", "close") or (
                kind == "bar" and self.bars and self._closes()
            ):
                while self.peek()[0] == "space":
                    self.at += 1
                return " ".join(latex)
            while self.peek()[0] == "space":
                self.at += 1
            if kind == "sign" or text == "in":
                self.take()
                latex.append(SIGNS[text])
            else:
                latex.append(self.term())

    def _closes(self) -> bool:
        """A bar closes where something of its inside stands right before it."""
        return bool(self.at) and self.tokens[self.at - 1][0] != "space"

    def term(self) -> str:
        latex = self.tight()
        while True:
            kind, text = self.peek(skip=True)
            if kind in ("end", "close", "sign") or text == "in":
                return latex
            if kind == "bar" and self.bars and self._closes():
                return latex
            spaced = self.peek()[0] == "space"
            while self.peek()[0] == "space":
                self.at += 1
            if kind == "over":
                self.take()
                while self.peek()[0] == "space":
                    self.at += 1
                latex = rf"\frac{{{_bare(latex)}}}{{{_bare(self.tight())}}}"
            elif kind == "kron":
                self.take()
                latex += r" \otimes "
            elif kind == "dot":
                self.take()
                latex += r" \cdot "
            elif text == "x" and spaced and self._is_cross():
                self.take()
                latex += r" \times "
            else:
                latex += ("" if latex.endswith(" ") else r"\, ") + self.tight()

    def _is_cross(self) -> bool:
        """An `x` between two factors, or at a bracket's end, is the cross product."""
        after = [kind for kind, _ in self.tokens[self.at + 1 : self.at + 3]]
        return after[:1] == ["close"] or (
            after[:1] == ["space"] and after[1:] != ["sign"]
        )

    def tight(self) -> str:
        latex = self.factor()
        while self.peek()[0] == "tight":
            self.take()
            latex = rf"\tfrac{{{latex}}}{{{self.factor()}}}"
        return latex

    def factor(self) -> str:
        kind, text = self.take()
        if kind == "number":
            latex = re.sub(r"e(-?\d+)$", r" \\cdot 10^{\1}", text)
        elif kind == "words":
            latex = r"\text{on-time}"
        elif kind == "code":
            latex = r"\mathtt{" + text.strip("`").replace("_", r"\_") + "}"
        elif kind == "name":
            latex = self.named(text)
        elif kind == "open":
            latex = self.group(text)
        elif kind == "bar":
            self.bars += 1
            latex = r"\left|" + self.sequence() + r"\right|"
            self.bars -= 1
            if self.take()[0] != "bar":
                raise NoEquationError("|")
        elif text == "-":
            return "-" + self.factor()
        else:
            raise NoEquationError(text)
        return latex + self.after()

    def after(self) -> str:
        """Primes, powers and subscripts of a factor."""
        latex = ""
        while True:
            kind, text = self.peek()
            if kind == "prime":
                latex += text
                self.take()
            elif kind == "power":
                self.take()
                latex += "^{" + self.exponent() + "}"
            elif text == "_":
                self.take()
                sub = self.factor()
                latex += (
                    "_{" + (r"\perp" if sub == r"\mathrm{perp}" else _bare(sub)) + "}"
                )
            else:
                return latex

    def exponent(self) -> str:
        kind, text = self.take()
        if kind == "sign":
            following = self.peek()
            if following[0] in ("number", "name"):
                return text + self.take()[1]
            return text
        if kind == "open":
            latex = self.sequence()
            self.take()
            return latex
        if kind in ("number", "name"):
            return text
        raise NoEquationError(text)

    def group(self, opening: str) -> str:
        latex = self.sequence()
        kind, text = self.take()
        if kind != "close":
            raise NoEquationError("(")
        return rf"{{\left{opening}{latex}\right{text}}}"

    def named(self, text: str) -> str:
        called = self.peek() == ("open", "(")
        if self.peek() == ("open", "["):
            self.take()
            return name(text) + self.group("[")
        if text == "sqrt" and called:
            self.take()
            latex = self.sequence()
            self.take()
            return rf"\sqrt{{{latex}}}"
        sign = _integral_or_sum(text)
        if sign:
            return sign
        if text in FUNCTIONS:
            latex = rf"\{text}"
        elif text in OPERATORS and called:
            latex = rf"\operatorname{{{text}}}"
        else:
            latex = name(text)
        if called:
            self.take()
            latex += self.after() if latex.startswith("\\operatorname") else ""
            latex += self.group("(")
        elif text in FUNCTIONS:
            latex += self.after()
            while self.peek()[0] == "space":
                self.take()
            latex += " " + self.tight()
        return latex


def _integral_or_sum(text: str) -> str:
    """Return the LaTeX of an integral or sum sign, or "" for another name."""
    if text == "integral" or text == "int" or text.startswith("int_"):
        return r"\int "
    if text == "sum":
        return r"\sum "
    if text.startswith("sum_"):
        return rf"\sum_{{{text[4:]}}} "
    return ""


def _bare(latex: str) -> str:
    """What a bracket holds where nothing else stands beside it."""
    inner = re.fullmatch(r"\{\\left\((.*)\\right\)\}", latex)
    if not inner:
        return latex
    depth = 0
    for sign in re.findall(r"\\(left|right)\b", inner[1]):
        depth += 1 if sign == "left" else -1
        if depth < 0:
            return latex
    return inner[1]


def _sub(text: str) -> str:
    if len(text) == 1 and text.islower():
        return text
    return r"\mathrm{" + text.replace("_", r"\,") + "}" if not text.isdigit() else text


def name(text: str) -> str:
    """A variable: letters and Greek with subscripts, words upright as the variable's
    own name."""
    base, _, sub = text.partition("_")
    digits = re.fullmatch(r"([A-Za-z]|[a-z]{2})(\d+)", base)
    if digits:
        base, sub = digits[1], digits[2] + (f"_{sub}" if sub else "")
    if base in GREEK:
        latex = f"\\{base}"
    elif len(base) == 1 or base in ("kp", "kd", "ki", "dq", "dt", "wn"):
        latex = base if len(base) == 1 else rf"\mathrm{{{base}}}"
    else:
        return r"\mathrm{" + text.replace("_", r"\_") + "}"
    return latex + (f"_{{{_sub(sub)}}}" if sub else "")
