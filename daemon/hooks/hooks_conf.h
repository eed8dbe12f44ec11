/* The configuration file of mesorig-hooks, hooks.conf. */
#pragma once

#include "base/options.h"

#define HOOKS_CONF "/etc/mesorig/hooks.conf"

struct hooks_conf {
    char *folder;        /* folder of the executables */
    double time_limit_s; /* time limit of each executable */
};

/* Reads the file. If path is NULL, only the defaults are set. The error lists all mistakes of the
 * file. */
gboolean hooks_conf_load(struct hooks_conf *conf, const char *path, GError **error);
void hooks_conf_clear(struct hooks_conf *conf);
typedef struct hooks_conf HooksConf;
G_DEFINE_AUTO_CLEANUP_CLEAR_FUNC(HooksConf, hooks_conf_clear)

/* Returns the option table of the section [class_name]. The only section is [hooks]; for any other
 * name, returns NULL. */
const struct option *hooks_conf_options(const char *class_name);
