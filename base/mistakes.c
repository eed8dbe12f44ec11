#include "mistakes.h"

#include "error_details.h"

/* A file of 1 MiB can contain half a million mistakes. Only this number is kept. */
#define KEPT 1000

struct Mistakes {
    GPtrArray *list;   /* elements: GError *, in the order in which they were found */
    GHashTable *texts; /* the texts of the errors, as a set; the strings belong to list */
    guint n_dropped;
};

Mistakes *mistakes_new(void) {
    Mistakes *mistakes = g_new0(Mistakes, 1);
    mistakes->list = g_ptr_array_new_with_free_func((GDestroyNotify)g_error_free);
    mistakes->texts = g_hash_table_new(g_str_hash, g_str_equal);
    return mistakes;
}

void mistakes_free(Mistakes *mistakes) {
    if (!mistakes)
        return;
    g_hash_table_unref(mistakes->texts);
    g_ptr_array_unref(mistakes->list);
    g_free(mistakes);
}

gboolean mistakes_add(Mistakes *mistakes, GError *mistake) {
    const gboolean again = mistake && g_hash_table_contains(mistakes->texts, mistake->message);
    if (!mistake || again || mistakes->list->len >= KEPT) {
        mistakes->n_dropped += mistake && !again;
        g_clear_error(&mistake);
        return FALSE;
    }
    g_hash_table_add(mistakes->texts, mistake->message);
    g_ptr_array_add(mistakes->list, mistake);
    return FALSE;
}

guint mistakes_count(const Mistakes *mistakes) {
    return mistakes->list->len + mistakes->n_dropped;
}

static int compare_mistakes(gconstpointer a, gconstpointer b) {
    const GError *const *errors[] = {a, b};
    int lines[2];
    for (int i = 0; i < 2; i++) {
        lines[i] = error_details_line(*errors[i]);
        if (lines[i] == 0)
            lines[i] = G_MAXINT;
    }
    return (lines[0] > lines[1]) - (lines[0] < lines[1]);
}

gboolean mistakes_report(const Mistakes *mistakes, GError **error) {
    const guint n = mistakes_count(mistakes);
    if (n == 0)
        return TRUE;
    g_autoptr(GPtrArray) sorted = g_ptr_array_copy(mistakes->list, NULL, NULL);
    g_ptr_array_set_free_func(sorted, NULL);
    g_ptr_array_sort(sorted, compare_mistakes); /* g_ptr_array_sort() is stable */
    const GError *first = sorted->pdata[0];
    if (n == 1) {
        g_propagate_error(error, g_error_copy(first));
        return FALSE;
    }
    g_autoptr(GString) text = g_string_new(NULL);
    g_string_append_printf(text, "%u mistakes:", n);
    for (guint i = 0; i < MIN(n, MISTAKES_SHOWN); i++)
        g_string_append_printf(text, "\n%s", ((const GError *)sorted->pdata[i])->message);
    if (n > MISTAKES_SHOWN)
        g_string_append_printf(text, "\nand %u more", n - MISTAKES_SHOWN);
    GError *all = g_error_copy(first);
    error_details_replace(&all, text->str);
    g_propagate_error(error, all);
    return FALSE;
}
