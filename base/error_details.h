/*
 * Errors that carry, beside their text, what failed and what to do about it. Code that shows such
 * an error reads these as data and never parses the message.
 *
 * The text is "FILE:LINE: WHERE: SUBJECT: WHAT HAPPENED; ADVICE"; every part but WHAT HAPPENED may
 * be missing. Each function that reads details takes any error: one of another domain has none.
 * Copies of an error keep them; an error that has crossed D-Bus has its text alone. Any thread.
 */
#pragma once

#include <glib.h>

/* Separates, in a format string, what happened from the advice:
 *     "no answer within %g ms" ERROR_ADVICE "check its power and its cable"
 * The message shows it as "; ". A second one in the same text belongs to the advice. */
#define ERROR_ADVICE "\x1e"

/* Makes an error domain whose errors carry details, for the domain's quark function; name must be
 * static. A further call with the same name returns the same quark. There are at most
 * ERROR_DETAILS_DOMAINS domains. */
#define ERROR_DETAILS_DOMAINS 8
GQuark error_details_domain(const char *name);

/* subject: what failed, as an operator knows it ("axis turntable"); NULL: not known here. */
GError *error_details_new(GQuark domain, int code, const char *subject, const char *format, ...)
    G_GNUC_PRINTF(4, 5);
GError *error_details_new_valist(GQuark domain, int code, const char *subject, const char *format,
                                 va_list args) G_GNUC_PRINTF(4, 0);

/* Puts "SUBJECT: " in front of the text, for an error from a lower layer that does not know the
 * subject. An error of another domain gets the text, but no subject. NULL and a pointer to NULL are
 * ignored. */
void error_details_add_subject(GError **error, const char *subject);

/* The same for the place in a file that has led to the error: "FILE:LINE: WHERE: ", as in
 * "rig.conf:12: [axis turntable] bus: ". Line 0 and where NULL: that part is left out. */
void error_details_add_place(GError **error, const char *file, int line, const char *where);

/* Replaces all of the message but the file: it becomes "FILE: TEXT", or TEXT if no file is known.
 * The error then has no subject and advice; domain and code remain. */
void error_details_replace(GError **error, const char *text);

int error_details_line(const GError *error); /* line of the place; 0: none, or not known */

/* Each returns NULL if the error has no such part. The error owns the strings. */
const char *error_details_subject(const GError *error);
const char *error_details_file(const GError *error); /* of the place */
const char *error_details_advice(const GError *error);

/* The text without its subject and what stands before that; the whole text if it has no subject. */
const char *error_details_text(const GError *error);

/* The description of the failure alone, without subject and advice. */
const char *error_details_what(const GError *error);
