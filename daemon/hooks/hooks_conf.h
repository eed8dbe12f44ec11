/* The file hooks.conf, which says what happens when a capture reaches a milestone. */
#pragma once

#include "base/options.h"

#define HOOKS_CONF "/etc/mesorig/hooks.conf"

/* The events of the signal Milestone (etc/org.mesorig.Rig1.xml), and "unsafe" and "confirmed"
 * (hooks.h); ends with NULL. */
extern const char *const hooks_events[];

struct hooks_mail {
    char **to;
    char *from, *sendmail;
    char **events;
};

struct hooks_webhook {
    char *name; /* of its section */
    char *url;
    char *token_file; /* "": none; relative to the file */
    char **events;
    double time_limit_s;
    int retries;    /* of a post that failed */
    double retry_s; /* from its failure to the first of them; from each to the next twice as long */
};

struct hooks_conf {
    char *folder;        /* of the executables */
    double time_limit_s; /* of each */
    gboolean mails;      /* mail is filled */
    struct hooks_mail mail;
    GArray *webhooks; /* of struct hooks_webhook */
};

/* Reads the file. If path is NULL, only the defaults are set. The error lists all mistakes of the
 * file. */
gboolean hooks_conf_load(struct hooks_conf *conf, const char *path, GError **error);
void hooks_conf_clear(struct hooks_conf *conf);
typedef struct hooks_conf HooksConf;
G_DEFINE_AUTO_CLEANUP_CLEAR_FUNC(HooksConf, hooks_conf_clear)

/* The keys of [hooks], [mail] and [webhook NAME]; NULL: there is no such section. */
const struct option *hooks_conf_options(const char *class_name);
