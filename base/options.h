/*
 * Option tables. They declare the keys of a section of a configuration file, next to the code that
 * uses them. The parser, its checks, the help of `mesorig drivers` and the manual page are made
 * from one table.
 */
#pragma once

#include "config.h"

enum option_type {
    OPTION_BOOL,   /* gboolean: yes/no, true/false */
    OPTION_INT,    /* int */
    OPTION_DOUBLE, /* double, finite */
    OPTION_STRING, /* char *, owned by the target */
    /* char *: absolute path; a relative one is relative to the folder of the file */
    OPTION_PATH,
    OPTION_CHOICE,  /* int: index into choices */
    OPTION_DOUBLES, /* struct option_doubles: numbers separated by ';', each within the range */
    OPTION_STRINGS, /* char **, NULL-terminated: texts separated by ';' */
    OPTION_SHARE,   /* double above 0 and below 1, written as 2% or 0.02 */
    /* gint64, written as 20MB or 500kB (powers of 1000, as g_format_size() prints them) */
    OPTION_BYTES,
};

struct option_doubles {
    double *values; /* owned by the target */
    int n;
};

struct option {
    const char *name; /* the unit is in the name: settle_ms, theta_deg */
    enum option_type type;
    const char *unit; /* for the help text; NULL if there is none */
    /* INT, DOUBLE, DOUBLES: inclusive range; if min and max are equal, any finite value is
     * allowed */
    double min, max;
    /* The default as written in a file; NULL if the user must give the key. */
    const char *fallback;
    const char *const *choices; /* CHOICE: NULL-terminated */
    gsize offset;               /* offset of the field in the target struct */
    const char *help;           /* one sentence, no full stop */
};

/* Fills target from a section. target must be zeroed. Every key of the section must be in the table
 * or in `also`, a NULL-terminated list of keys that other code reads. `also` may be NULL. On
 * failure target contains nothing that needs to be freed. If only the unit suffix of a key is wrong
 * (settle_s for settle_ms), the error says so. The table ends with an entry whose name is NULL. */
gboolean options_parse(const struct option *table, const struct config_section *section,
                       const char *const *also, gpointer target, GError **error);

/* A table and the struct that it fills. */
struct option_target {
    const struct option *table;
    gpointer target;
};

/* The same as options_parse() for a section whose keys belong to several tables. All mistakes of
 * the section are added to mistakes. A required key is not reported as missing if a misspelt key
 * probably meant it, or if a line of the section could not be parsed. "*" in `also` allows any
 * other key. Returns TRUE if there are no mistakes and no line was left out. */
gboolean options_read(const struct option_target *targets, gsize n_targets,
                      const struct config_section *section, const char *const *also,
                      Mistakes *mistakes);

/* Sets the field of an option in target from a text, for example from the command line. The error
 * does not name the option. */
gboolean options_set(const struct option *option, const char *text, gpointer target,
                     GError **error);

/* Returns the option of that name; NULL if there is none. */
const struct option *options_find(const struct option *table, const char *name);

/* Returns the range as text, for example "1 to 32"; NULL if the option has no range. Free it
 * with g_free(). */
char *options_range(const struct option *option);

/* Checks one key of a section: the key must be in the table or in `also`, and its value must be
 * valid. */
gboolean options_check_key(const struct option *table, const struct config_section *section,
                           const char *const *also, const char *key, GError **error);

/* Fills target with the defaults. Keys without a default are left zero. */
void options_defaults(const struct option *table, gpointer target);

/* Frees the strings and lists in a target, not the target itself. */
void options_clear(const struct option *table, gpointer target);

/* Appends the help text, with one paragraph for each option: name, type, unit, range, default,
 * help. */
void options_describe(const struct option *table, GString *to);

/* Appends the same information as a JSON array of objects. */
void options_describe_json(const struct option *table, GString *to);
