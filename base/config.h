/*
 * This module reads configuration files in GKeyFile syntax. It keeps the line of every key for
 * error messages.
 *
 * A section "[class name]" (as in "[axis turntable]") has a class and a name; "[session]" has only
 * a class. A Config is read once and never changed; it may be read from any thread.
 *
 * Every file that people write is read by this module: rig files, sessions, worlds, hooks, targets
 * and files of nominal values. Most of them describe their keys in option tables (options.h). Files
 * that a program writes for itself are read with GKeyFile: calibrations, the queue, and the rates
 * of processing. Tables of numbers are read with text_table.h.
 */
#pragma once

#include "mistakes.h"

#include <glib.h>

#define CONFIG_ERROR config_error_quark()
GQuark config_error_quark(void); /* errors of this domain carry details (base/error_details.h) */

/* Messages have the form "FILE:LINE: [section] key: what is wrong and what would be right". */
enum config_error {
    /* the file or a line of the file is not in this syntax, or a section or key is given twice */
    CONFIG_ERROR_SYNTAX,
    CONFIG_ERROR_UNKNOWN, /* a key, section, driver or choice that does not exist */
    CONFIG_ERROR_MISSING, /* a required key, or a section that another section names, is missing */
    CONFIG_ERROR_VALUE,   /* a value is not of its type, is out of range, or does not fit others */
};

typedef struct Config Config;

struct config_section {
    const Config *config; /* not owned */
    char *group;          /* the text between the brackets */
    char *class_name;     /* first word of the heading */
    char *name;           /* rest of the heading, or NULL */
    int line;
    /* The heading could not be parsed, so the keys of the section must be ignored. Always FALSE
     * after config_load_lenient(). */
    gboolean broken;
    /* A line of the section could not be parsed, so keys may be missing. Always FALSE after
     * config_load_lenient(). */
    gboolean incomplete;
    GPtrArray *keys;     /* elements: char *, in file order, NULL-terminated; owned by the Config */
    GHashTable *entries; /* maps a key to its value and line; private to config.c */
};

/* Loads a file of at most 1 MiB. Relative paths in the file are relative to its folder. Returns
 * NULL with an error on failure. The error lists the wrong lines, at most MISTAKES_SHOWN of them.
 * Free the result with config_free(). */
Config *config_load(const char *path, GError **error);

/* The same as config_load() and config_parse(), for a reader that reports all mistakes of the file
 * together. A line that cannot be parsed is left out, and a mistake is added for it. The reader
 * then adds the mistakes that it finds in the other lines. Returns NULL if the file cannot be used
 * at all; mistakes then contains the reason. */
Config *config_load_checked(const char *path, Mistakes *mistakes);
Config *config_parse_checked(const char *text, const char *path, Mistakes *mistakes);

/* Returns whether all headings could be parsed. If the result is FALSE, config_find() may not find
 * a section that is in the file, because the heading of that section could not be parsed. */
gboolean config_has_all_sections(const Config *config);

/* A line that config_load_lenient() could not understand. */
struct config_problem {
    char *message; /* "FILE:LINE: what is wrong" */
    int line;
};

/* Loads a file that may contain errors, for code that must work in any case (the safe state). A
 * line that cannot be understood is left out and listed in config_problems(). A heading that is
 * broken or repeated begins a new section, whose name contains the number of the line. A second
 * key "driver" in a section also begins a new section, whose class is CONFIG_NO_HEADING. The keys
 * above the second "driver" belong to the section that has the first one. The function fails only
 * if the file cannot be read. */
#define CONFIG_NO_HEADING "unnamed"
Config *config_load_lenient(const char *path, GError **error);

/* Returns an array of the *ret_n problems that config_load_lenient() has found, in file order. The
 * Config owns it. For a Config that another function loaded, returns NULL, and *ret_n is 0. */
const struct config_problem *config_problems(const Config *config, gsize *ret_n);

/* The same as config_load() for a text in memory. path names the text in messages, and relative
 * paths in the text are relative to the folder of path. */
Config *config_parse(const char *text, const char *path, GError **error);

void config_free(Config *config); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Config, config_free)

/* Returns the path of the file. The Config owns the string. */
const char *config_path(const Config *config);
/* Returns the text of the file as it was read. The Config owns the string. */
const char *config_text(const Config *config);

/* Returns the array of all sections, of which there are *ret_n, in file order. The Config owns
 * it. */
const struct config_section *config_sections(const Config *config, gsize *ret_n);

/* Returns the section with this class and name. If name is NULL, returns the only section of the
 * class. Returns NULL if there is no such section, if its heading is broken, or if name is NULL and
 * the class has several sections. */
const struct config_section *config_find(const Config *config, const char *class_name,
                                         const char *name);

/* Returns the value of a key as text, or NULL if the section does not have the key. If the section
 * has the key and ret_line is not NULL, *ret_line is set to the line of the key. The Config owns
 * the text. */
const char *config_value(const struct config_section *section, const char *key, int *ret_line);

/* Returns all keys of a section in file order, NULL-terminated. The Config owns them. */
const char *const *config_keys(const struct config_section *section);

/* Returns the absolute form of a path. A relative path is relative to the folder of the file. Free
 * the result with g_free(). */
char *config_resolve(const Config *config, const char *path);

/* Sets an error that begins with file, line and section. key may be NULL. Always returns FALSE, so
 * that a caller can return its value. */
gboolean config_set_error(GError **error, enum config_error code,
                          const struct config_section *section, const char *key, const char *format,
                          ...) G_GNUC_PRINTF(5, 6);

/* The same as config_set_error(), but adds the error to the mistakes of a file. Always returns
 * FALSE. */
gboolean config_mistake(Mistakes *mistakes, enum config_error code,
                        const struct config_section *section, const char *key, const char *format,
                        ...) G_GNUC_PRINTF(5, 6);

/* Adds the mistake that something is missing in the file as a whole. Always returns FALSE. */
gboolean config_lacks(Mistakes *mistakes, const Config *config, const char *format, ...)
    G_GNUC_PRINTF(3, 4);
