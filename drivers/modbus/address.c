#include "address.h"

#include <gio/gio.h>
#include <netdb.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#define TCP          "tcp:"
#define DEFAULT_PORT 502

gboolean modbus_is_tcp(const char *bus) {
    return g_str_has_prefix(bus, TCP);
}

/* Returns the host and port of tcp:HOST:PORT, or NULL if the text after "tcp:" is not a host. */
static GNetworkAddress *parse_tcp(const char *bus) {
    return (GNetworkAddress *)g_network_address_parse(bus + strlen(TCP), DEFAULT_PORT, NULL);
}

char *modbus_address_name(const char *bus) {
    if (!modbus_is_tcp(bus)) {
        char *real = realpath(bus, NULL);
        char *name = g_strdup(real ? real : bus);
        free(real);
        return name;
    }
    g_autoptr(GNetworkAddress) address = parse_tcp(bus);
    if (!address)
        return g_strdup(bus);
    g_autofree char *host = g_ascii_strdown(g_network_address_get_hostname(address), -1);
    g_autoptr(GInetAddress) numbers = g_inet_address_new_from_string(host);
    g_autofree char *numeric = numbers ? g_inet_address_to_string(numbers) : NULL;
    const char *shown = numeric ? numeric : g_str_equal(host, "localhost") ? "127.0.0.1" : host;
    return g_strdup_printf(strchr(shown, ':') ? TCP "[%s]:%u" : TCP "%s:%u", shown,
                           g_network_address_get_port(address));
}

char *modbus_address_of(const char *what, int number, const char *bus, int unit) {
    g_autofree char *name = modbus_address_name(bus);
    return g_strdup_printf("%s %d of unit %d at %s", what, number, unit, name);
}

/* Returns the key of a unit at an address. An IPv4 address that is mapped to IPv6 is converted
 * to IPv4. */
static char *unit_key(GInetAddress *address, guint16 port, int unit) {
    const guint8 *bytes = g_inet_address_to_bytes(address);
    static const guint8 mapped[12] = {[10] = 0xff, [11] = 0xff};
    g_autoptr(GInetAddress) four =
        g_inet_address_get_native_size(address) == 16 && memcmp(bytes, mapped, 12) == 0
            ? g_inet_address_new_from_bytes(bytes + 12, G_SOCKET_FAMILY_IPV4)
            : NULL;
    GInetAddress *known = four ? four : address;
    /* A connection to the address of all interfaces reaches this computer. */
    g_autofree char *numbers =
        g_inet_address_get_is_any(known) ? g_strdup("127.0.0.1") : g_inet_address_to_string(known);
    return g_strdup_printf("tcp %s %u unit %d", numbers, port, unit);
}

/* Returns the keys of a unit, one for each address of its host. It calls getaddrinfo() and not
 * GResolver: a child process of the safe state does not have the threads of GResolver. */
static GPtrArray *unit_keys(const char *bus, int unit) {
    const struct addrinfo wanted = {.ai_socktype = SOCK_STREAM};
    GPtrArray *keys = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GNetworkAddress) network = parse_tcp(bus);
    struct addrinfo *all = NULL;
    if (!network || getaddrinfo(g_network_address_get_hostname(network), NULL, &wanted, &all) != 0)
        return keys;
    for (const struct addrinfo *item = all; item; item = item->ai_next) {
        g_autoptr(GSocketAddress) address =
            g_socket_address_new_from_native(item->ai_addr, item->ai_addrlen);
        if (!G_IS_INET_SOCKET_ADDRESS(address))
            continue;
        GInetAddress *numbers = g_inet_socket_address_get_address((GInetSocketAddress *)address);
        g_autofree char *key = unit_key(numbers, g_network_address_get_port(network), unit);
        if (!g_ptr_array_find_with_equal_func(keys, key, g_str_equal, NULL))
            g_ptr_array_add(keys, g_steal_pointer(&key));
    }
    freeaddrinfo(all);
    return keys;
}

static void release(gpointer lock) {
    lock_release(lock);
}

GPtrArray *modbus_address_lock_unit(const char *bus, int unit, GError **error) {
    g_autoptr(GPtrArray) keys = unit_keys(bus, unit);
    g_autoptr(GPtrArray) locks = g_ptr_array_new_with_free_func(release);
    g_autofree char *what = g_strdup_printf("unit %d at %s", unit, bus);
    for (guint i = 0; i < keys->len; i++) {
        Lock *lock = lock_take(keys->pdata[i], LOCK_SHARED, what, error);
        if (!lock)
            return NULL;
        g_ptr_array_add(locks, lock);
    }
    return g_steal_pointer(&locks);
}

gboolean modbus_address_unit_holder(const char *bus, int unit, pid_t *ret_pid) {
    g_autoptr(GPtrArray) keys = unit_keys(bus, unit);
    for (guint i = 0; i < keys->len; i++)
        if (lock_holder(keys->pdata[i], ret_pid))
            return TRUE;
    return FALSE;
}
