"""Write user-supplied text, names and numbers into generated C so that it compiles as intended."""

from __future__ import annotations

import re

import numpy as np

COMMENT_MAX = 80  # characters of a text in a comment

# C up to C23, then C++.
_KEYWORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int long
register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
alignas alignof bool constexpr false nullptr static_assert thread_local true typeof typeof_unqual
and and_eq asm bitand bitor catch char8_t char16_t char32_t class co_await co_return co_yield compl concept
consteval constinit const_cast decltype delete dynamic_cast explicit export friend mutable namespace new
noexcept not not_eq operator or or_eq private protected public reinterpret_cast requires static_cast
template this throw try typeid typename using virtual wchar_t xor xor_eq
"""
# Names that <math.h> and <string.h> declare or define, including default compiler extensions. C++ includes
# <stdlib.h> with them. Each function of the first list also exists with the suffixes f and l.
_MATH = """
acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh drem erf erfc exp exp2 exp10 expm1 fabs
fdim finite floor fma fmax fmin fmod frexp gamma hypot ilogb isinf isnan j0 j1 jn ldexp lgamma llrint
llround log log10 log1p log2 logb lrint lround modf nan nearbyint nextafter nexttoward pow pow10 remainder
remquo rint round scalb scalbln scalbn significand sin sincos sinh sqrt tan tanh tgamma trunc y0 y1 yn
"""
_LIBRARY = """
lgamma_r lgammaf_r lgammal_r signgam fpclassify isfinite isgreater isgreaterequal isless islessequal
islessgreater isnormal isunordered signbit math_errhandling float_t double_t INFINITY NAN NULL HUGE_VAL
HUGE_VALF HUGE_VALL FP_INFINITE FP_NAN FP_NORMAL FP_SUBNORMAL FP_ZERO FP_ILOGB0 FP_ILOGBNAN FP_FAST_FMA
FP_FAST_FMAF FP_FAST_FMAL MATH_ERRNO MATH_ERREXCEPT M_E M_LOG2E M_LOG10E M_LN2 M_LN10 M_PI M_PI_2 M_PI_4
M_1_PI M_2_PI M_2_SQRTPI M_SQRT2 M_SQRT1_2 size_t locale_t memccpy memchr memcmp memcpy memmem memmove
mempcpy memrchr memset rawmemchr stpcpy stpncpy strcasecmp strcasecmp_l strcasestr strcat strchr strchrnul
strcmp strcoll strcoll_l strcpy strcspn strdup strdupa strerror strerror_l strerror_r strfry strlcat strlcpy
strlen strncasecmp strncasecmp_l strncat strncmp strncpy strndup strndupa strnlen strpbrk strrchr strsep
strsignal strspn strstr strtok strtok_r strverscmp strxfrm strxfrm_l basename bcmp bcopy bzero
explicit_bzero ffs ffsl ffsll index rindex abort abs atexit atof atoi atol atoll bsearch calloc div div_t
exit free getenv labs ldiv ldiv_t llabs lldiv lldiv_t malloc mblen mbstowcs mbtowc qsort quick_exit rand
random realloc realpath select srand srandom std strtod strtof strtol strtold strtoll strtoul strtoull
system wcstombs wctomb main linux unix RAD_PER_DEG
"""
# A header with one of these names in the folder of the C file would replace the header of the system.
_HEADERS = """
assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdalign stdarg
stdatomic stdbit stdbool stdckdint stddef stdint stdio stdlib stdnoreturn string strings tgmath threads time
uchar wchar wctype
"""
KEYWORDS = frozenset(_KEYWORDS.split())
LIBRARY = frozenset([name + end for name in _MATH.split() for end in ("", "f", "l")] + _LIBRARY.split())
HEADERS = frozenset(_HEADERS.split())


def comment(text: str) -> str:
    """Convert a text to printable ASCII that neither ends nor begins a C comment.

    Parameters
    ----------
    text : str
        Other characters become <U+code>. A long text is cut.

    Returns
    -------
    str
    """
    text = text if len(text) <= COMMENT_MAX else f"{text[:COMMENT_MAX]} ..."
    plain = "".join(c if " " <= c <= "~" and c != "\\" else f"<U+{ord(c):04X}>" for c in text)
    # Split */, /*, // and trigraphs by a space.
    return re.sub(r"(?<=\*)(?=/)|(?<=/)(?=[*/])|(?<=\?)(?=\?)", " ", plain)


def refused_name(name: str) -> str:
    """Explain why C or C++ rejects a name for a type and as a prefix of functions; empty if both accept it.

    Parameters
    ----------
    name : str

    Returns
    -------
    str
    """
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        return "it is not a C identifier"
    if name.startswith("_") or "__" in f"{name}_":
        return "names with such underscores are reserved for compilers"
    if name in KEYWORDS:
        return "it is a keyword"
    if name in LIBRARY:
        return "the C library uses it"
    if name.lower() in HEADERS:
        return "it is a header of the C library"
    return ""


def literal(value: float) -> str:
    """Write a float literal that reads back as the same float.

    Parameters
    ----------
    value : float

    Returns
    -------
    str

    Raises
    ------
    ValueError
        The value is not finite in single precision.
    """
    with np.errstate(over="ignore"):
        single = np.float32(value)
    if not np.isfinite(single):
        raise ValueError(f"{value:g} is not a finite number in single precision")
    text = f"{single:.9g}"
    return f"{text}f" if re.search(r"[.e]", text) else f"{text}.0f"
