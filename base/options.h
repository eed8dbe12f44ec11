/*
 * Option tables: the keys of a section of a configuration file, declared beside the code that uses
 * them. The parser, its checks, the help of `mesorig drivers` and the manual page come from one
 * table.
 */
#pragma once

#include "config.h"

enum option_type {
    OPTION_BOOL,    /* gboolean: yes/no, true/false */
    OPTION_INT,     /* int */
    OPTION_DOUBLE,  /* double, finite */
    OPTION_STRING,  /* char *, owned by the target */
    OPTION_PATH,    /* char *, made absolute relative to the file */
    OPTION_CHOICE,  /* int: index into choices */
    OPTION_DOUBLES, /* struct option_doubles: numbers separated by ';', each within the range */
    OPTION_STRINGS, /* char **, NULL-terminated, separated by ';' */
    OPTION_SHARE,   /* double above 0 and below 1, written as 2% or 0.02 */
    OPTION_BYTES, /* gint64, written as 20MB or 500kB: thousands, as g_format_size() prints them */
};

struct option_doubles {
    double *values; /* owned by the target */
    int n;
};

struct option {
    const char *name; /* the unit is in the name: settle_ms, theta_deg */
    enum option_type type;
    const char *unit; /* for the help text; NULL where there is none */
    double min, max;  /* INT, DOUBLE, DOUBLES: inclusive range; both the same: any finite value */
    const char *fallback;       /* the default as written in a file; NULL: the key must be given */
    const char *const *choices; /* CHOICE: NULL-terminated */
    gsize offset;               /* of the field in the target struct */
    const char *help;           /* one sentence, no full stop */
};

/* Fills target (zeroed before) from a section. Every key must be in the table, or in also
 * (NULL-terminated names that somebody else reads; may be NULL). On failure target holds nothing
 * that needs freeing. The error for a key whose unit suffix alone is wrong (settle_s for settle_ms)
 * says so. The table ends with an entry whose name is NULL. */
gboolean options_parse(const struct option *table, const struct config_section *section,
                       const char *const *also, gpointer target, GError **error);

/* A table and the struct that it fills. */
struct option_target {
    const struct option *table;
    gpointer target;
};

/* The same as options_parse() for keys that belong to one of several tables; adds all mistakes of
 * the section to mistakes (the error of options_parse() lists all of them, too). A required key is
 * not reported as missing if a misspelt key was taken for it, or if a line of the section could not
 * be parsed. "*" in also: allows any other key. TRUE: there are no mistakes, and no line was left
 * out. */
gboolean options_read(const struct option_target *targets, gsize n_targets,
                      const struct config_section *section, const char *const *also,
                      Mistakes *mistakes);

/* Sets one field of target from a text, as on a command line: the error does not name the option.
 */
gboolean options_set(const struct option *option, const char *text, gpointer target,
                     GError **error);

/* Returns the option of that name; NULL if there is none. */
const struct option *options_find(const struct option *table, const char *name);

/* Returns the range as text, for example "1 to 32"; NULL if all values are allowed. g_free() */
char *options_range(const struct option *option);

/* Checks one key of a section: that the table or also has it, and that its value is valid. */
gboolean options_check_key(const struct option *table, const struct config_section *section,
                           const char *const *also, const char *key, GError **error);

/* Fills target with the defaults alone; keys without one are left zero. */
void options_defaults(const struct option *table, gpointer target);

/* Frees the strings and lists in a target, not the target itself. */
void options_clear(const struct option *table, gpointer target);

/* Help text, one paragraph per option: name, type, unit, range, default, help. */
void options_describe(const struct option *table, GString *to);

/* The same as a JSON array of objects. */
void options_describe_json(const struct option *table, GString *to);
