/* The result of a command: one record of named values, which is printed as JSON, and the sentences
 * that are printed for people in its place. A command fills it; the harness in cli.c prints it. */
#pragma once

#include <gio/gio.h>

typedef struct Record Record;

Record *record_new(void);
void record_free(Record *record); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Record, record_free)

/* Values; JSON shows them in the order in which they were added. Strings that are not UTF-8 are
 * repaired; NULL is "". */
void record_string(Record *to, const char *key, const char *value);
void record_strings(Record *to, const char *key, const GPtrArray *values); /* of char * */
void record_int(Record *to, const char *key, gint64 value);
void record_double(Record *to, const char *key, double value);
void record_doubles(Record *to, const char *key, const double *values, int n);
void record_boolean(Record *to, const char *key, gboolean value);
void record_variant(Record *to, const char *key, GVariant *value); /* takes a floating reference */
void record_variants(Record *to, GVariant *values);                /* each of an "a{sv}" */

/* Begins a list of records, or a record within this one; in a list its key is NULL. Values that
 * follow belong to it, until record_end(). */
void record_begin_list(Record *to, const char *key);
void record_begin(Record *to, const char *key);
void record_end(Record *to);

/* Appends to the text for people; JSON does not have it. */
void record_say(Record *to, const char *format, ...) G_GNUC_PRINTF(2, 3);

/* Prints the values as a line of JSON, or else the text. An empty record prints nothing. Call it
 * once: nothing may be added later. */
void record_print(Record *record, gboolean json);
