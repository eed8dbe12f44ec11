#include "webgl_page.h"

#include <gio/gio.h>
#include <string.h>

#define PAGE "/org/mesorig/webgl/page.html"
/* bytes of the material in one step of the page's progress; a multiple of 3 */
#define CHUNK (3 << 17)
#define TITLE "<!--TITLE-->"
/* occurs once in the page, after the elements that show the progress */
#define DATA "<!--DATA-->"

/* Returns the resource that contains the page. The build generates this function. */
GResource *webgl_resource_get_resource(void);

static const char *webgl_page_template(GBytes **ret_owner) {
    g_autoptr(GError) error = NULL;
    *ret_owner = g_resource_lookup_data(webgl_resource_get_resource(), PAGE,
                                        G_RESOURCE_LOOKUP_FLAGS_NONE, &error);
    g_assert_no_error(error);
    return g_bytes_get_data(*ret_owner, NULL); /* a resource always ends in NUL */
}

static gint64 chunks(gint64 material) {
    return (material + CHUNK - 1) / CHUNK;
}

gint64 webgl_page_bytes(gint64 material) {
    g_autoptr(GBytes) owner = NULL;
    webgl_page_template(&owner);
    return (gint64)g_bytes_get_size(owner) + (material + 2) / 3 * 4 +
           chunks(material) * (gint64)strlen("<script>chunk(\"\")</script>\n") + 1024;
}

/* Appends the material. Its data are divided into pieces, and each piece is a separate script. The
 * browser runs a script while it still reads the next one, so that the page can show its
 * progress. */
static void append_data(GString *page, GBytes *material) {
    gsize size;
    const guint8 *data = g_bytes_get_data(material, &size);
    g_string_append_printf(page, "<script>begin(%zu)</script>\n", size);
    for (gsize at = 0; at < size; at += CHUNK) {
        g_autofree char *text = g_base64_encode(data + at, MIN(CHUNK, size - at));
        g_string_append_printf(page, "<script>chunk(\"");
        g_string_append(page, text);
        g_string_append(page, "\")</script>\n");
    }
}

GBytes *webgl_page(const char *name, GBytes *material) {
    g_autoptr(GBytes) owner = NULL;
    const char *from = webgl_page_template(&owner);
    const char *title = strstr(from, TITLE), *data = strstr(from, DATA);
    g_assert(title && data && title < data);
    g_autofree char *valid = g_utf8_make_valid(name, -1);
    g_autofree char *escaped = g_markup_escape_text(valid, -1);
    GString *page = g_string_sized_new((gsize)webgl_page_bytes((gint64)g_bytes_get_size(material)));
    g_string_append_len(page, from, title - from);
    g_string_append(page, escaped);
    g_string_append_len(page, title + strlen(TITLE), data - title - (gssize)strlen(TITLE));
    append_data(page, material);
    g_string_append(page, data + strlen(DATA));
    return g_string_free_to_bytes(page);
}
