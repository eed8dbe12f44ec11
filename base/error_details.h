/*
 * Errors that carry, in addition to their text, the subject that failed and advice. Code that shows
 * such an error reads these parts as data and never parses the message.
 *
 * The text is "FILE:LINE: WHERE: SUBJECT: WHAT HAPPENED; ADVICE". Every part except WHAT HAPPENED
 * may be missing. The functions that read details accept any error; an error of another domain has
 * no details. Copies of an error keep the details. An error that has crossed D-Bus has only its
 * text. Any thread may call these functions.
 */
#pragma once

#include <glib.h>

/* Separates the description of the failure from the advice in a format string:
 *     "no answer within %g ms" ERROR_ADVICE "check its power and its cable"
 * The message shows the separator as "; ". What follows a second separator in the same text
 * belongs to the advice. */
#define ERROR_ADVICE "\x1e"

/* Makes an error domain whose errors carry details, for the quark function of the domain. name must
 * be static. A further call with the same name returns the same quark. There are at most
 * ERROR_DETAILS_DOMAINS domains. */
#define ERROR_DETAILS_DOMAINS 8
GQuark error_details_domain(const char *name);

/* Makes an error. subject is the thing that failed, as an operator knows it ("axis turntable"). It
 * is NULL if the caller does not know it. */
GError *error_details_new(GQuark domain, int code, const char *subject, const char *format, ...)
    G_GNUC_PRINTF(4, 5);
GError *error_details_new_valist(GQuark domain, int code, const char *subject, const char *format,
                                 va_list args) G_GNUC_PRINTF(4, 0);

/* Puts "SUBJECT: " in front of the message of an error from a lower layer that does not know the
 * subject. An error of a domain without details gets the text, but no subject. error may be NULL or
 * point to NULL; it is then ignored. */
void error_details_add_subject(GError **error, const char *subject);

/* Puts "FILE:LINE: WHERE: " in front of the message: the place in a file that has led to the error,
 * as in "rig.conf:12: [axis turntable] bus: ". If line is 0, ":LINE" is left out. If where is NULL,
 * "WHERE: " is left out. */
void error_details_add_place(GError **error, const char *file, int line, const char *where);

/* Replaces the whole message. The message becomes "FILE: TEXT", or TEXT if the error has no file.
 * The error then has no subject and no advice. Its domain and code do not change. */
void error_details_replace(GError **error, const char *text);

/* Returns the line that error_details_add_place() has set; 0 if the error has none. */
int error_details_line(const GError *error);

/* The following functions return NULL if the error has no such part. The error owns the strings. */
const char *error_details_subject(const GError *error);
const char *error_details_file(const GError *error); /* file of the place */
const char *error_details_advice(const GError *error);

/* Returns the message without the subject and the parts before it. Returns the whole message if the
 * error has no subject. */
const char *error_details_text(const GError *error);

/* Returns only the description of the failure (WHAT HAPPENED). Returns the whole message if the
 * error has no details. */
const char *error_details_what(const GError *error);
