/* Finds things that two sections of a rig file need exclusively: the same coil, relay, axis or
 * camera. */
#include "devices_private.h"

/* Returns FALSE if its options have mistakes, which are reported elsewhere. */
static gboolean read_needs(const struct config_section *section, const struct driver_info *info,
                           GPtrArray *to) {
    static const char *const any[] = {"*", NULL};
    g_autoptr(Mistakes) unheard = mistakes_new();
    g_autofree gpointer options = g_malloc0(MAX(info->priv_size, 1));

    if (!options_read(&(struct option_target){info->options, options}, 1, section, any, unheard))
        return FALSE;
    info->needs(options, to);
    options_clear(info->options, options);
    return TRUE;
}

/* Reports only the first such thing of each section. */
static void check_section(GHashTable *owners, const struct config_section *section,
                          const GPtrArray *needs, Mistakes *mistakes) {
    gboolean told = FALSE;

    for (guint i = 0; i < needs->len; i++) {
        const struct config_section *owner = g_hash_table_lookup(owners, needs->pdata[i]);
        if (owner && owner != section && !told)
            told = !config_mistake(mistakes, CONFIG_ERROR_VALUE, section, NULL,
                                   "%s is already used by [%s], in line %d; correct one of the two",
                                   (const char *)needs->pdata[i], owner->group, owner->line);
        if (!owner)
            g_hash_table_insert(owners, g_strdup(needs->pdata[i]), (gpointer)section);
    }
}

void layout_check_needs(const Config *config, Mistakes *mistakes) {
    g_autoptr(GHashTable) owners = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    gsize n;
    const struct config_section *sections = config_sections(config, &n);

    for (gsize i = 0; i < n; i++) {
        const struct driver_info *info = sections[i].broken ? NULL : drivers_by_name(&sections[i]);
        g_autoptr(GPtrArray) needs = g_ptr_array_new_with_free_func(g_free);
        if (info && info->needs && read_needs(&sections[i], info, needs))
            check_section(owners, &sections[i], needs, mistakes);
    }
}
