#include "hooks_conf.h"

#include <string.h>

#define HOOKS(member) G_STRUCT_OFFSET(struct hooks_conf, member)
static const struct option hooks_options[] = {
    {"folder", OPTION_PATH, .fallback = "/etc/mesorig/hooks.d", .offset = HOOKS(folder),
     .help = "Folder of the hooks: executables that are run for every event, in the order of their "
             "names"},
    {"time_limit_s", OPTION_DOUBLE, "s", 0.1, 86400, "60", .offset = HOOKS(time_limit_s),
     .help = "Time that a hook may take before it is ended"},
    {NULL},
};

const struct option *hooks_conf_options(const char *class_name) {
    return strcmp(class_name, "hooks") == 0 ? hooks_options : NULL;
}

static void take_section(struct hooks_conf *conf, const struct config_section *section,
                         Mistakes *mistakes) {
    if (strcmp(section->class_name, "hooks") == 0) {
        options_clear(hooks_options, conf);
        options_read(&(struct option_target){hooks_options, conf}, 1, section, NULL, mistakes);
    } else {
        config_mistake(mistakes, CONFIG_ERROR_UNKNOWN, section, NULL,
                       "there is no such section: [hooks] is the only section of this file");
    }
}

gboolean hooks_conf_load(struct hooks_conf *conf, const char *path, GError **error) {
    g_autoptr(Mistakes) mistakes = mistakes_new();
    g_autoptr(Config) config = path ? config_load_checked(path, mistakes) : NULL;
    gsize n = 0;
    *conf = (struct hooks_conf){0};
    options_defaults(hooks_options, conf);
    const struct config_section *sections = config ? config_sections(config, &n) : NULL;
    for (gsize i = 0; i < n; i++)
        if (!sections[i].broken)
            take_section(conf, &sections[i], mistakes);
    if (mistakes_report(mistakes, error))
        return TRUE;
    hooks_conf_clear(conf);
    return FALSE;
}

void hooks_conf_clear(struct hooks_conf *conf) {
    options_clear(hooks_options, conf);
}
