/* A number and its noun in messages. */
#pragma once

/* The two arguments of "%d %s" for n things, n an int, whose plural ends in s: PLURAL (n, "view")
 * gives "1 view" or "3 views". n is evaluated twice. */
#define PLURAL(n, noun) (n), (n) == 1 ? noun : noun "s"
