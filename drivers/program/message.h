/*
 * Messages of programs that are devices: JSON-RPC 2.0, one object a line.
 * docs/build-a-rig/programs.md is the specification.
 *
 * A program may send anything. A line is checked for its length, for UTF-8 and for its number of
 * brackets before it is parsed, and every value is checked for its type and its range. All
 * functions are pure, and any thread may call them. Errors are DEVICE_ERROR_PROTOCOL without a
 * subject.
 */
#pragma once

#include <json-glib/json-glib.h>

#define MESSAGE_VERSION 1
#define MESSAGE_MAX     65536 /* largest number of bytes of a line, without its end */
/* Largest number of [ and { in a line. json-glib calls itself for each level of arrays and
 * objects, so a line of brackets would use up the stack. The number is easier to check than the
 * depth, because brackets inside a text may be counted as well. */
#define MESSAGE_MAX_BRACKETS 64

/* An answer or an event. Strings are valid UTF-8 without control characters. */
struct message {
    /* id of the request that this answers; 0 for an event, and for the error of a program that
     * could not read a request */
    guint64 id;
    char *event;   /* name of the event; NULL for an answer */
    char *failure; /* the reason why the request failed; NULL if it did not fail */
    /* values of the answer or the event; empty if there are none, NULL with a failure */
    JsonObject *values;
    gboolean is_2_0; /* "jsonrpc" is "2.0" */
};

/* Reads a line without its end. Clear ret with message_clear(). On failure ret need not be
 * cleared. */
gboolean message_read(const char *line, gsize length, struct message *ret, GError **error);
void message_clear(struct message *message);

/* Returns a request as a line with its end. deadline_ms is the time that the program has for its
 * answer. Takes ownership of params, which may be NULL. Free the line with g_free(). */
char *message_write(guint64 id, const char *method, gint64 deadline_ms, JsonObject *params);

/* The following functions read a value of an answer. The error says what is missing or wrong. */
gboolean message_number(JsonObject *values, const char *name, double min, double max, double *ret,
                        GError **error);
gboolean message_integer(JsonObject *values, const char *name, gint64 min, gint64 max, gint64 *ret,
                         GError **error);
gboolean message_boolean(JsonObject *values, const char *name, gboolean *ret, GError **error);
/* Reads an array of n values true or false. */
gboolean message_booleans(JsonObject *values, const char *name, int n, gboolean *ret,
                          GError **error);

/* Reads an array of one or more integers. *ret_n is their number. Free *ret with g_free(). */
gboolean message_integers(JsonObject *values, const char *name, gint64 min, gint64 max,
                          gint64 **ret, int *ret_n, GError **error);

/* Returns the text with this name as one line, shortened to 300 bytes. Returns "" if there is none.
 * Free it with g_free(). */
char *message_text(JsonObject *values, const char *name);

/* Returns whether the value with this name is an array that contains a text. */
gboolean message_has(JsonObject *values, const char *name, const char *text);
