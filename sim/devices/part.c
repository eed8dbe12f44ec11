#include "part.h"

#include <gio/gio.h>

#include "world/world.h"

void sim_part_check(const struct config_section *section, const char *world_path, const char *key,
                    const char *name, const char *class_name, const char *const *others,
                    Mistakes *mistakes) {
    const char *wanted = *name ? name : section->name;
    g_autoptr(Mistakes) of_world = mistakes_new();
    if (!*world_path)
        return;
    if (!g_file_test(world_path, G_FILE_TEST_EXISTS)) {
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "world",
                       "there is no file %s: correct the path", world_path);
        return;
    }
    g_autoptr(Config) world = config_load_checked(world_path, of_world);
    if (!world || mistakes_count(of_world) > 0 || (others && g_strv_contains(others, wanted)) ||
        config_find(world, class_name, wanted))
        return;
    g_autoptr(GString) choices = g_string_new(NULL);
    for (; others && *others; others++)
        g_string_append_printf(choices, "%s%s", choices->len ? ", " : "", *others);
    gsize n;
    const struct config_section *sections = config_sections(world, &n);
    for (gsize i = 0; i < n; i++)
        if (g_str_equal(sections[i].class_name, class_name) && sections[i].name)
            g_string_append_printf(choices, "%s%s", choices->len ? ", " : "", sections[i].name);
    config_mistake(mistakes, CONFIG_ERROR_UNKNOWN, section, key,
                   "%s has no %s \"%s\"; choose from: %s", world_path, class_name, wanted,
                   choices->len ? choices->str : "(none)");
}
