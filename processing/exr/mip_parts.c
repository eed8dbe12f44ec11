/* Prefixes and counts the parts of mip levels. */
#include "mip_parts.h"

#include <string.h>

static char *prefix_of(int number) {
    return number > 0 ? g_strdup_printf("mip%d.", number) : g_strdup("");
}

void mip_parts_add(struct exr_file *file, struct exr_file *level, int number) {
    g_autofree char *prefix = prefix_of(number);
    while (level->parts->len > 0) {
        struct exr_part *part = g_ptr_array_steal_index(level->parts, 0);
        g_autofree char *name = part->name;
        part->name = g_strconcat(prefix, name, NULL);
        exr_file_add(file, part);
    }
    exr_file_free(level);
}

/* Returns the level of a part from its name: n if the name begins with "mip<n>.", otherwise 0. */
static gint64 level_of(const struct exr_part *part) {
    char *end = NULL;
    if (!g_str_has_prefix(part->name, "mip") || !g_ascii_isdigit(part->name[3]))
        return 0;
    const gint64 number = g_ascii_strtoll(part->name + 3, &end, 10);
    return *end == '.' ? number : 0;
}

int mip_parts_count(const struct exr_file *file, const char *part, const char *path,
                    GError **error) {
    for (int n = 1;; n++) {
        g_autofree char *prefix = prefix_of(n);
        g_autofree char *name = g_strconcat(prefix, part, NULL);
        if (exr_file_part(file, name))
            continue;
        for (guint i = 0; i < file->parts->len; i++) {
            const struct exr_part *other = file->parts->pdata[i];
            if (level_of(other) < n)
                continue;
            g_set_error(
                error, EXR_ERROR, EXR_ERROR_MISSING,
                "%s: has a part \"%s\", but no \"%s\"; copy the file again or compress again", path,
                other->name, name);
            return 0;
        }
        return n;
    }
}

struct exr_file *mip_parts_take(struct exr_file *file, int number) {
    struct exr_file *level = exr_file_new();
    g_autofree char *prefix = prefix_of(number);
    for (guint i = 0; i < file->parts->len;) {
        const struct exr_part *part = file->parts->pdata[i];
        if (number > 0 ? !g_str_has_prefix(part->name, prefix)
                       : g_str_has_prefix(part->name, "mip")) {
            i++;
            continue;
        }
        struct exr_part *taken = g_ptr_array_steal_index(file->parts, i);
        g_autofree char *name = taken->name;
        taken->name = g_strdup(name + strlen(prefix));
        exr_file_add(level, taken);
    }
    return level;
}
