#include "link.h"

#include <string.h>

#include "address.h"

const char *const modbus_parities[] = {"none", "even", "odd", NULL};

gboolean modbus_link_is_same(const struct modbus_link *a, const struct modbus_link *b) {
    return a->baud == b->baud && a->parity == b->parity && a->stop_bits == b->stop_bits &&
           a->timeout_ms == b->timeout_ms && a->late_ms == b->late_ms && a->retries == b->retries;
}

static gboolean is_same_line(const char *a, const char *b) {
    g_autofree char *one = modbus_address_name(a), *two = modbus_address_name(b);
    return strcmp(one, two) == 0;
}

void modbus_link_check(const struct modbus_link *link, const struct config_section *section,
                       Mistakes *mistakes) {
    static const struct option table[] = {MODBUS_LINK_OPTIONS, {NULL}};
    static const char *const any[] = {"*", NULL};
    gsize n;
    const struct config_section *sections = config_sections(section->config, &n);
    for (gsize i = 0; i < n && &sections[i] != section; i++) {
        struct modbus_link other = {0};
        g_autoptr(Mistakes) theirs = mistakes_new();
        const char *bus = config_value(&sections[i], "bus", NULL);
        if (sections[i].broken || !bus || !is_same_line(bus, link->bus) ||
            !options_read(&(struct option_target){table, &other}, 1, &sections[i], any, theirs))
            continue;
        const gboolean same = modbus_link_is_same(&other, link);
        options_clear(table, &other);
        if (same)
            continue;
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "bus",
                       "[%s], in line %d, opens %s with other settings; make baud, parity, "
                       "stop_bits, timeout_ms, late_ms and retries the same",
                       sections[i].group, sections[i].line, link->bus);
        return;
    }
}
