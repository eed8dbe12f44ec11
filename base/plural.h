/* A number and its noun in messages. */
#pragma once

/* Expands to the two arguments of "%d %s" for a number and a noun whose plural ends in s. PLURAL
 * (n, "view") gives "1 view" or "3 views". n is an int and is evaluated twice. */
/* NOLINTNEXTLINE(bugprone-macro-parentheses): "s" is appended to a string literal */
#define PLURAL(n, noun) (n), (n) == 1 ? noun : noun "s"
