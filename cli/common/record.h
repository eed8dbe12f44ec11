/* The result of a command: named values for --json, and text for people. A command describes its
 * result once, and cli.c prints one of the two. */
#pragma once

#include <glib.h>

typedef struct Record Record;

Record *record_new(void);
void record_free(Record *record); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Record, record_free)

/* Appends text for people. If a key in braces follows a conversion, the value of the conversion is
 * also added to the JSON under this key:
 *
 *     record_say(to, "%d{views} views, error %.2f{error:%%}, in %g{real_s:time}\n",
 *                81, 0.0123, 65.0)
 *
 * adds {"views": 81, "error": 0.0123, "real_s": 65} and says "81 views, error 1.23 %, in 1 min 5
 * s". The word after the colon says how the text shows the value:
 *
 *     %%     a share, as per cent
 *     time   seconds, as report_duration() writes them
 *     size   bytes, as g_format_size() writes them
 *
 * The key may be empty: "{:time}" only changes the text. The conversions are %d, %i and %u (with l
 * or ll for an integer of 64 bits), %f, %g, %s, %c and %%. Another letter ends the program. Widths
 * of strings count characters, not bytes. A NULL string is "". */
void record_say(Record *to, const char *format, ...) G_GNUC_PRINTF(2, 3);

/* The same as record_say(), but if said is FALSE, only the values are added and the text is left
 * out. */
void record_say_if(Record *to, gboolean said, const char *format, ...) G_GNUC_PRINTF(3, 4);

/* Adds only values: record_add(to, "%d{views} %d{lights}", 81, 81). */
#define record_add(to, ...) record_say_if(to, FALSE, __VA_ARGS__)

/* Add one value under a key. JSON shows values in the order in which they were added. Bytes of a
 * string that are not valid UTF-8 are replaced. */
void record_string(Record *to, const char *key, const char *value);
void record_double(Record *to, const char *key, double value);
void record_doubles(Record *to, const char *key, const double *values, int n);
void record_int(Record *to, const char *key, gint64 value);
void record_boolean(Record *to, const char *key, gboolean value);
void record_variant(Record *to, const char *key, GVariant *value); /* takes a floating reference */
/* Adds each entry of a value of type "a{sv}" under its own key. */
void record_variants(Record *to, GVariant *values);

/* Add an array of char *. record_say_strings() also appends a line for each string to the text. The
 * line is `before`, followed by the string. */
void record_strings(Record *to, const char *key, const GPtrArray *values);
void record_say_strings(Record *to, const char *key, const char *before, const GPtrArray *values);
/* Adds an array of n numbers. The text shows them with one blank between two numbers, each in the
 * format of one double: record_say_doubles(to, "point_mm", "%.2f", values, 3) says "1.00 2.50
 * 0.25". */
void record_say_doubles(Record *to, const char *key, const char *format, const double *values,
                        int n);

/* Begin a list of records, or a record within the present list or record. The values that are added
 * until record_end() belong to the new list or record. If the parent is a list, key is NULL. At
 * most 8 levels may be open at a time. */
void record_begin_list(Record *to, const char *key);
void record_begin(Record *to, const char *key);
void record_end(Record *to);

/* Prints the values as a line of JSON, or the text for people. An empty record prints nothing. Call
 * it once, and add nothing afterwards. */
void record_print(Record *record, gboolean json);
