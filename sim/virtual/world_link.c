#include "world_link.h"

#include <gio/gio.h>
#include <string.h>

static const struct {
    const char *prefix;
    enum world_part_kind kind;
    int (*find)(const World *world, const char *name);
} named[] = {
    {"sweep ", WORLD_PART_SWEEP, world_find_laser},
    {"lamp ", WORLD_PART_LAMP, world_find_lamp},
    {"laser ", WORLD_PART_LASER, world_find_laser},
};

static const struct {
    const char *name;
    enum world_part_kind kind;
    void (*turn)(World *world, double deg);
} axes[] = {
    {"turntable", WORLD_PART_TURNTABLE, world_set_turntable},
    {"arc", WORLD_PART_ARC, world_set_arc},
    {"arm", WORLD_PART_ARM, world_set_arm},
    {"probe", WORLD_PART_PROBE, world_set_probe},
};

static gboolean world_link_find(const World *world, const char *name, struct world_part *ret) {
    for (gsize i = 0; i < G_N_ELEMENTS(axes); i++)
        if (strcmp(name, axes[i].name) == 0) {
            ret->kind = axes[i].kind;
            return TRUE;
        }
    for (gsize i = 0; i < G_N_ELEMENTS(named); i++) {
        if (!g_str_has_prefix(name, named[i].prefix))
            continue;
        ret->kind = named[i].kind;
        ret->index = named[i].find(world, name + strlen(named[i].prefix));
        return ret->index >= 0;
    }
    return FALSE;
}

gboolean world_part_find(World *world, const char *name, struct world_part *ret, GError **error) {
    struct world_part part = {0};
    if (!world_link_find(world, name, &part)) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                    "the world has no \"%s\"; give turntable, arc, arm or probe, or \"sweep "
                    "NAME\", \"lamp NAME\" or \"laser NAME\" with a name in the world file",
                    name);
        return FALSE;
    }
    part.world = world_ref(world);
    *ret = part;
    return TRUE;
}

void world_part_clear(struct world_part *part) {
    world_unref(part->world);
    *part = (struct world_part){0};
}

void world_part_switch(const struct world_part *part, gboolean on, gint64 at_us) {
    if (part->kind == WORLD_PART_LAMP)
        world_set_lamp(part->world, part->index, on, at_us);
    else if (part->kind == WORLD_PART_LASER)
        world_set_laser(part->world, part->index, on);
}

void world_part_turn(const struct world_part *part, double deg, double deg_s, gint64 at_us) {
    if (part->kind == WORLD_PART_TURNTABLE && deg_s != 0) {
        world_turn_turntable(part->world, deg, deg_s, at_us);
        return;
    }
    for (gsize i = 0; i < G_N_ELEMENTS(axes); i++)
        if (part->kind == axes[i].kind)
            axes[i].turn(part->world, deg);
    if (part->kind == WORLD_PART_SWEEP)
        world_set_sweep(part->world, part->index, deg);
}
