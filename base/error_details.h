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
 * The message shows it as "; ". A second one in the same text belongs to the advice. */
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

/* Puts "SUBJECT: " in front of the text of an error from a lower layer that does not know the
 * subject. An error of another domain gets the text, but no subject. error may be NULL or point to
 * NULL; it is then ignored. */
void error_details_add_subject(GError **error, const char *subject);

/* Puts the place in a file that has led to the error in front of its text: "FILE:LINE: WHERE: ", as
 * in "rig.conf:12: [axis turntable] bus: ". Line 0 leaves the line out, and where NULL leaves WHERE
 * out. */
void error_details_add_place(GError **error, const char *file, int line, const char *where);

/* Replaces the whole message except the file. The message becomes "FILE: TEXT", or TEXT if no file
 * is known. The error then has no subject and no advice. Its domain and code do not change. */
void error_details_replace(GError **error, const char *text);

/* Returns the line of the place; 0 if there is none or it is not known. */
int error_details_line(const GError *error);

/* The following functions return NULL if the error has no such part. The error owns the strings. */
const char *error_details_subject(const GError *error);
const char *error_details_file(const GError *error); /* file of the place */
const char *error_details_advice(const GError *error);

/* Returns the text without its subject and the parts before it. Returns the whole text if the error
 * has no subject. */
const char *error_details_text(const GError *error);

/* Returns only the description of the failure, without subject and advice. */
const char *error_details_what(const GError *error);
