/* LED controller for Mesorig (docs/build-a-rig/led-controller.md), for Arduino boards with an AVR
 * and for ESP32. The lamps are dark after power-up and reset, when no valid line has come for
 * DARK_MS, and, because of the hardware watchdog, when this program hangs. */
#include <Arduino.h>
#ifdef ARDUINO_ARCH_AVR
#include <avr/wdt.h>
#endif

/* The pins of lamps 0, 1, … These have PWM on an Arduino Uno or Nano. A pin that is high lights its
 * lamp. At most 64 lamps; a pin without PWM needs the level 255. */
static const uint8_t pins[] = {3, 5, 6, 9, 10, 11};

#define N_LAMPS sizeof pins
#define DARK_MS 2000u

static uint8_t levels[N_LAMPS];
static char line[32];
static uint8_t length; /* sizeof line: the line is too long, and is dropped */
static unsigned long heard_ms;
static uint16_t sum; /* of the answer so far */

static uint16_t add_to_sum(uint16_t crc, uint8_t byte) {
    crc ^= (uint16_t)byte << 8;
    for (uint8_t bit = 0; bit < 8; bit++)
        crc = crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1;
    return crc;
}

static void put(char c) {
    Serial.write(c);
    sum = add_to_sum(sum, c);
}

static void put_hex(uint16_t value, uint8_t digits) {
    while (digits-- > 0)
        put("0123456789abcdef"[value >> 4 * digits & 15]);
}

static long read_hex(const char *at, uint8_t digits) {
    long value = 0;
    for (; digits > 0; digits--, at++) {
        const bool letter = *at >= 'a' && *at <= 'f';
        if (!letter && (*at < '0' || *at > '9'))
            return -1;
        value = 16 * value + (letter ? *at - 'a' + 10 : *at - '0');
    }
    return value;
}

static void set_level(uint8_t lamp, uint8_t level) {
    levels[lamp] = level;
    analogWrite(pins[lamp], level);
}

static void all_off() {
    for (uint8_t i = 0; i < N_LAMPS; i++)
        set_level(i, 0);
}

/* The level of a lamp. A pin that should be constant is read back. */
static uint8_t read_level(uint8_t lamp) {
#ifdef ARDUINO_ARCH_AVR
    const uint8_t pin = pins[lamp];
    const bool high = *portInputRegister(digitalPinToPort(pin)) & digitalPinToBitMask(pin);
    if (levels[lamp] == 0 || levels[lamp] == 255)
        return high ? 255 : 0;
#endif
    return levels[lamp];
}

static void answer(uint16_t number, char kind) {
    sum = 0xffff;
    put('L'), put('1'), put(' ');
    put_hex(number, 4);
    put(' '), put(kind), put(' ');
    put_hex(DARK_MS, 4);
    put(' ');
    for (uint8_t i = 0; i < N_LAMPS; i++)
        put_hex(read_level(i), 2);
    const uint16_t total = sum;
    put('*');
    put_hex(total, 4);
    put('\n');
}

/* Obeys a line. A line that is damaged is dropped. */
static void obey() {
    const uint8_t n = length - 5; /* without the checksum */
    if (length < 14 || length == sizeof line || strncmp(line, "L1 ", 3) || line[n] != '*')
        return;
    uint16_t crc = 0xffff;
    for (uint8_t i = 0; i < n; i++)
        crc = add_to_sum(crc, line[i]);
    const long number = read_hex(line + 3, 4);
    if (read_hex(line + n + 1, 4) != crc || number <= 0)
        return;
    heard_ms = millis();
    const long lamp = n == 15 ? read_hex(line + 10, 2) : -1;
    const long level = n == 15 ? read_hex(line + 13, 2) : -1;
    char kind = 'E';
    if (line[8] == 'p' && n == 9) {
        kind = 'P';
    } else if (line[8] == 'o' && n == 9) {
        all_off();
        kind = 'O';
    } else if (line[8] == 's' && lamp >= 0 && lamp < (long)N_LAMPS && level >= 0) {
        set_level(lamp, level);
        kind = 'S';
    }
    answer(number, kind);
}

void setup() {
    for (uint8_t i = 0; i < N_LAMPS; i++) {
        digitalWrite(pins[i], LOW);
        pinMode(pins[i], OUTPUT);
        set_level(i, 0);
    }
    Serial.begin(115200);
#ifdef ARDUINO_ARCH_AVR
    wdt_enable(WDTO_1S);
#else
    enableLoopWDT(); /* ESP32 resets itself when loop() hangs for 5 s */
#endif
    answer(0, 'R');
}

void loop() {
#ifdef ARDUINO_ARCH_AVR
    wdt_reset();
#endif
    if (millis() - heard_ms > DARK_MS)
        all_off();
    /* Bounded, so that noise does not keep the lamps lit. */
    for (uint8_t i = 0; i < sizeof line && Serial.available(); i++) {
        const char c = Serial.read();
        if (c != '\n' && c != '\r') {
            if (length < sizeof line)
                line[length++] = c;
            continue;
        }
        obey();
        length = 0;
    }
}
