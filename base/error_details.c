#include "error_details.h"

#include <string.h>

struct details {
    /* text is the message behind the subject, usually "WHAT; ADVICE". what and advice are its parts
     * before and after the first ERROR_ADVICE. */
    char *file, *subject, *text, *what, *advice;
    int line;
};

/* GLib puts the private data of an error in front of the GError, and rounds the size of these data
 * up to this alignment. */
#define ALIGNMENT (2 * sizeof(gsize))
#define OFFSET    ((sizeof(struct details) + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT)

static GMutex lock;
static GQuark domains[ERROR_DETAILS_DOMAINS];

static struct details *details_of(const GError *error) {
    gboolean known = FALSE;
    g_mutex_lock(&lock);
    for (int i = 0; error && i < ERROR_DETAILS_DOMAINS; i++)
        known |= domains[i] != 0 && domains[i] == error->domain;
    g_mutex_unlock(&lock);
    return known ? (gpointer)((char *)(gpointer)error - OFFSET) : NULL;
}

static void details_init(GError *error) {
    (void)error; /* GLib has already zeroed the details */
}

static void details_copy(const GError *from, GError *to) {
    const struct details *source = details_of(from);
    *details_of(to) =
        (struct details){g_strdup(source->file), g_strdup(source->subject), g_strdup(source->text),
                         g_strdup(source->what), g_strdup(source->advice),  source->line};
}

static void details_clear(GError *error) {
    struct details *details = details_of(error);
    g_free(details->file);
    g_free(details->subject);
    g_free(details->text);
    g_free(details->what);
    g_free(details->advice);
}

GQuark error_details_domain(const char *name) {
    g_mutex_lock(&lock);
    GQuark quark = g_quark_try_string(name);
    int i = 0;
    while (i < ERROR_DETAILS_DOMAINS && domains[i] && domains[i] != quark)
        i++;
    g_assert(i < ERROR_DETAILS_DOMAINS);
    if (!domains[i])
        domains[i] = g_error_domain_register_static(name, sizeof(struct details), details_init,
                                                    details_copy, details_clear);
    quark = domains[i];
    g_mutex_unlock(&lock);
    return quark;
}

GError *error_details_new_valist(GQuark domain, int code, const char *subject, const char *format,
                                 va_list args) {
    g_autofree char *marked = g_strdup_vprintf(format, args);
    g_auto(GStrv) parts = g_strsplit(marked, ERROR_ADVICE, -1);
    g_autofree char *text = g_strjoinv("; ", parts);
    GError *error =
        g_error_new(domain, code, "%s%s%s", subject ? subject : "", subject ? ": " : "", text);
    struct details *details = details_of(error);
    g_assert(details); /* details is NULL only if error_details_domain() did not make the domain */
    *details = (struct details){.subject = g_strdup(subject),
                                .text = g_steal_pointer(&text),
                                .what = g_strdup(*parts ? *parts : ""),
                                .advice = *parts && parts[1] ? g_strjoinv("; ", parts + 1) : NULL};
    return error;
}

GError *error_details_new(GQuark domain, int code, const char *subject, const char *format, ...) {
    va_list args;
    va_start(args, format);
    GError *error = error_details_new_valist(domain, code, subject, format, args);
    va_end(args);
    return error;
}

void error_details_add_subject(GError **error, const char *subject) {
    struct details *details = error ? details_of(*error) : NULL;
    if (details) {
        g_autofree char *what = details->subject
                                    ? g_strconcat(details->subject, ": ", details->what, NULL)
                                    : g_strdup(details->what ? details->what : (*error)->message);
        g_free(details->text);
        g_free(details->what);
        g_free(details->subject);
        /* The text includes prefixes that other functions have put in front of the message. */
        details->text = g_strdup((*error)->message);
        details->what = g_steal_pointer(&what);
        details->subject = g_strdup(subject);
    }
    g_prefix_error(error, "%s: ", subject);
}

void error_details_add_place(GError **error, const char *file, int line, const char *where) {
    struct details *details = error ? details_of(*error) : NULL;
    if (details) {
        g_free(details->file);
        details->file = g_strdup(file);
        details->line = line;
    }
    g_autofree char *number = line > 0 ? g_strdup_printf(":%d", line) : g_strdup("");
    g_prefix_error(error, "%s%s: %s%s", file, number, where ? where : "", where ? ": " : "");
}

void error_details_replace(GError **error, const char *text) {
    struct details *details = details_of(*error);
    const char *file = details ? details->file : NULL;
    char *message = file ? g_strconcat(file, ": ", text, NULL) : g_strdup(text);
    g_free((*error)->message);
    (*error)->message = message;
    if (!details)
        return;
    g_clear_pointer(&details->subject, g_free);
    g_clear_pointer(&details->text, g_free);
    g_clear_pointer(&details->what, g_free);
    g_clear_pointer(&details->advice, g_free);
}

int error_details_line(const GError *error) {
    const struct details *details = details_of(error);
    return details ? details->line : 0;
}

const char *error_details_subject(const GError *error) {
    const struct details *details = details_of(error);
    return details ? details->subject : NULL;
}

const char *error_details_file(const GError *error) {
    const struct details *details = details_of(error);
    return details ? details->file : NULL;
}

const char *error_details_advice(const GError *error) {
    const struct details *details = details_of(error);
    return details ? details->advice : NULL;
}

const char *error_details_text(const GError *error) {
    const struct details *details = details_of(error);
    return details && details->subject ? details->text : error->message;
}

const char *error_details_what(const GError *error) {
    const struct details *details = details_of(error);
    return details && details->what ? details->what : error->message;
}
