/* The result of a command: a record of named values, which is printed as JSON, and sentences for
 * people, which are printed otherwise. A command fills the record, and cli.c prints it. */
#pragma once

#include <gio/gio.h>

typedef struct Record Record;

Record *record_new(void);
void record_free(Record *record); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Record, record_free)

/* Add values. JSON shows them in the order in which they were added. Strings that are not UTF-8 are
 * repaired. NULL is written as "". */
void record_string(Record *to, const char *key, const char *value);
void record_strings(Record *to, const char *key, const GPtrArray *values); /* of char * */
void record_int(Record *to, const char *key, gint64 value);
void record_double(Record *to, const char *key, double value);
void record_doubles(Record *to, const char *key, const double *values, int n);
void record_boolean(Record *to, const char *key, gboolean value);
void record_variant(Record *to, const char *key, GVariant *value); /* takes a floating reference */
/* adds each value of an "a{sv}" */
void record_variants(Record *to, GVariant *values);

/* Begin a list of records, or a record within this one. A record in a list has NULL as its key. The
 * values that follow belong to it, until record_end(). */
void record_begin_list(Record *to, const char *key);
void record_begin(Record *to, const char *key);
void record_end(Record *to);

/* Appends to the text for people, which is not in the JSON. */
void record_say(Record *to, const char *format, ...) G_GNUC_PRINTF(2, 3);

/* Prints the values as a line of JSON, or the text for people. An empty record prints nothing. To
 * be called once; nothing may be added afterwards. */
void record_print(Record *record, gboolean json);
