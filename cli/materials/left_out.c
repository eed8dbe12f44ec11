#include "left_out.h"

#include "base/data_error.h"
#include "base/plural.h"

#include <string.h>

gboolean left_out_parse(const char *text, struct left_out *to) {
    const char *equals = strchr(text, '=');
    const gboolean views = !equals || g_str_has_prefix(text, "views=");
    const gboolean lights = !equals || g_str_has_prefix(text, "lights=");
    guint64 n;
    if (!(views || lights) ||
        !g_ascii_string_to_unsigned(equals ? equals + 1 : text, 10, 0, G_MAXINT, &n, NULL))
        return FALSE;
    to->views = views ? (int)n : 0;
    to->lights = lights ? (int)n : 0;
    return TRUE;
}

/* Returns how many of n directions are left out: `asked`, or the default if `asked` is negative. */
static int number(int asked, gsize n) {
    return asked >= 0 ? asked : held_out_default(n);
}

gboolean left_out_draw(const struct left_out *left_out, const char *path,
                       const struct btf_layout *layout, struct held_out *ret, GError **error) {
    const int views = number(left_out->views, layout->views.n);
    const int lights = number(left_out->lights, layout->lights.n);
    if (views > 0 || lights > 0 || left_out->views >= 0) {
        if (held_out_draw(layout, views, lights, left_out->seed, ret, error))
            return TRUE;
        g_prefix_error(error, "%s: ", path);
        return FALSE;
    }
    g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                "%s: the BTF has only %d %s and %d %s, so none can be left out; give --leave-out 0 "
                "for the errors at the measured directions",
                path, PLURAL((int)layout->views.n, "view"), PLURAL((int)layout->lights.n, "light"));
    return FALSE;
}

static void tell_list(Record *to, const char *key, const struct direction_list *list,
                      const int *indices, int n) {
    record_begin_list(to, key);
    for (int i = 0; i < n; i++) {
        record_begin(to, NULL);
        record_add(to, "%d{index} %g{theta_deg} %g{phi_deg}", indices[i],
                   (double)list->theta_deg[indices[i]], (double)list->phi_deg[indices[i]]);
        record_end(to);
    }
    record_end(to);
}

void left_out_tell(Record *to, const struct left_out *left_out, const struct btf_layout *layout,
                   const struct held_out *held) {
    const int views = held->n_views ? held->n_views : (int)layout->views.n;
    const int lights = held->n_lights ? held->n_lights : (int)layout->lights.n;
    record_int(to, "seed", left_out->seed);
    if (held->n_views || held->n_lights)
        record_say(to,
                   "%d %s and %d %s were left out (seed %u). Errors are those at %d{pairs} %s of a "
                   "view and a light that no method has seen.\n",
                   PLURAL(held->n_views, "view"), PLURAL(held->n_lights, "light"), left_out->seed,
                   PLURAL(views * lights, "pair"));
    else
        record_say(to,
                   "Errors are those at all %d{pairs} measured pairs of a view and a light, which "
                   "every method has seen.\n",
                   views * lights);
    tell_list(to, "left_out_views", &layout->views, held->views, held->n_views);
    tell_list(to, "left_out_lights", &layout->lights, held->lights, held->n_lights);
}
