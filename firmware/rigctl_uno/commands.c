/* Commands: a SCPI dialect. Headers have a short and a long form, in any case: SYST:ERR? or system:error?
 *
 * A host that wants to be sure puts a tag before a command, `#7 VALV EXT,1050`, and is answered `#7 OK`, the
 * query's reply, or `#7 !-221,"Settings conflict"` instead of an entry in the error queue. A command that ends
 * with `*` and its CRC-16/XMODEM in four hexadecimal digits is checked, and its answer has one too. */
#include <avr/pgmspace.h>
#include <avr/wdt.h>
#include <ctype.h>
#include <stdlib.h>
#include <string.h>
#include <util/atomic.h>

#include "board.h"

#define TEXT_OF(x) #x
#define TEXT(x) TEXT_OF(x)

/* --- the answer ------------------------------------------------------------------------------------------- */
static const char *tag; /* NULL: none */
static bool with_crc, answered;
static uint16_t answer_crc;

static void put_plain(char c) {
    answer_crc = crc_update(answer_crc, c);
    uart_put(c);
}

static void put(char c) {
    if (!answered) {
        answered = true;
        answer_crc = 0;
        if (tag) {
            for (const char *t = tag; *t; t++)
                put_plain(*t);
            put_plain(' ');
        }
    }
    put_plain(c);
}

static void put_text(const char *program_memory) {
    char c;
    while ((c = pgm_read_byte(program_memory++)))
        put(c);
}

static void put_unsigned(uint32_t value) {
    char digits[10], *end = decimal(value, digits);
    for (char *d = digits; d < end; d++)
        put(*d);
}

static void put_error(int16_t error) {
    if (error < 0)
        put('-');
    put_unsigned(error < 0 ? -error : error);
    put(',');
    put('"');
    if (error >= 100 && error < 106) {
        put_text(PSTR("Trip;"));
        put_text(trip_text(error - 100));
    } else {
        put_text(error_text(error));
    }
    put('"');
}

static void finish(int16_t error) {
    if (tag && error) {
        put('!');
        put_error(error);
    } else if (tag && !answered) {
        put_text(PSTR("OK"));
    } else if (error) {
        error_add(error);
    }
    if (!answered)
        return;
    if (with_crc) {
        uint16_t crc = answer_crc;
        uart_put('*');
        put_hex(crc, uart_put);
    }
    uart_put('\n');
}

/* --- parameters ------------------------------------------------------------------------------------------- */
static bool is(const char *given, const char *short_form, const char *long_form) {
    return !strcmp_P(given, short_form) || !strcmp_P(given, long_form);
}

/* A decimal number with at most three decimals, times 1000. */
static int16_t thousandths(const char *text, uint32_t highest, uint32_t *value) {
    uint32_t number = 0;
    uint8_t digits = 0;
    int8_t decimals = -1;
    for (; *text; text++) {
        if (*text == '.' && decimals < 0) {
            decimals = 0;
        } else if (isdigit((unsigned char)*text) && decimals < 3) {
            if (++digits > 9)
                return E_RANGE;
            number = number * 10 + (*text - '0');
            if (decimals >= 0)
                decimals++;
        } else {
            return E_DATA_TYPE;
        }
    }
    if (!digits)
        return E_DATA_TYPE;
    for (int8_t missing = decimals < 0 ? 3 : 3 - decimals; missing > 0; missing--) {
        if (number > UINT32_MAX / 10)
            return E_RANGE;
        number *= 10;
    }
    *value = number;
    return number > highest ? E_RANGE : E_NONE;
}

static int16_t whole(const char *text, uint32_t highest, uint32_t *value) {
    int16_t error = thousandths(text, highest * 1000UL, value);
    if (!error && *value % 1000UL)
        error = E_DATA_TYPE;
    *value /= 1000UL;
    return error;
}

/* --- the actions of commands ------------------------------------------------------------------------------- */
static int16_t identify(char *arg) {
    (void)arg;
    put_text(PSTR("RIGCTL,RIG-UNO,0," FIRMWARE_VERSION));
    return E_NONE;
}

static int16_t clear_status(char *arg) {
    (void)arg;
    error_clear();
    return E_NONE;
}

static int16_t reset(char *arg) { /* trips stay latched: they are cleared only explicitly */
    (void)arg;
    outputs_off();
    stream_set(0);
    return E_NONE;
}

static int16_t complete(char *arg) {
    (void)arg;
    put('1');
    return E_NONE;
}

static int16_t next_error(char *arg) {
    (void)arg;
    put_error(error_take());
    return E_NONE;
}

static int16_t errors(char *arg) {
    (void)arg;
    put_unsigned(error_count());
    return E_NONE;
}

static int16_t scpi_version(char *arg) {
    (void)arg;
    put_text(PSTR("1999.0"));
    return E_NONE;
}

static int16_t tell_trips(char *arg) {
    (void)arg;
    uint8_t causes = trips();
    put_unsigned(causes);
    put(',');
    put('"');
    bool first = true;
    for (uint8_t bit = 0; bit < 6; bit++) {
        if (!(causes & _BV(bit)))
            continue;
        if (!first)
            put_text(PSTR(", "));
        put_text(trip_text(bit));
        first = false;
    }
    put('"');
    return E_NONE;
}

static int16_t clear_trips(char *arg) {
    (void)arg;
    return trips_clear() ? E_NONE : E_CONFLICT;
}

static int16_t ping(char *arg) {
    (void)arg;
    return E_NONE;
}

static int16_t tell_time(char *arg) {
    (void)arg;
    put_unsigned(micros());
    return E_NONE;
}

static int16_t configuration(char *arg) {
    (void)arg;
    put_text(PSTR("baud=" TEXT(BAUD) ",pressure_trip=" TEXT(PRESSURE_TRIP) ",temperature_trip=" TEXT(
        TEMPERATURE_TRIP) ",open=" TEXT(OPEN_LOW) ":" TEXT(OPEN_HIGH) ",sensors=" TEXT(SENSORS) ",readings=" TEXT(
        TRIP_READINGS) ",host_ms=" TEXT(HOST_TIMEOUT_MS) ",valve_rest_ms=" TEXT(VALVE_REST_MS)
        ",heater_rest_ms=" TEXT(HEATER_REST_MS) ",heater_credit_s=" TEXT(HEATER_CREDIT_S)));
    return E_NONE;
}

static int16_t measure_all(char *arg) {
    (void)arg;
    put_unsigned(micros());
    for (uint8_t channel = 0; channel < 3; channel++) {
        put(',');
        put_unsigned(input(channel));
    }
    put(',');
    put_unsigned(outputs_bits());
    put(',');
    put_unsigned(pressure_counts());
    put(',');
    put_unsigned(trips());
    return E_NONE;
}

static int16_t heater(char *arg) {
    if (is(arg, PSTR("ON"), PSTR("1")))
        return heater_set(true);
    if (is(arg, PSTR("OFF"), PSTR("0")))
        return heater_set(false);
    return E_DATA_TYPE;
}

static int16_t tell_heater(char *arg) {
    (void)arg;
    put(heater_on() ? '1' : '0');
    return E_NONE;
}

static int16_t tell_credit(char *arg) {
    (void)arg;
    put_unsigned(heater_credit());
    return E_NONE;
}

static int16_t all_off(char *arg) {
    (void)arg;
    outputs_off();
    return E_NONE;
}

static int16_t valve(char *arg) {
    uint32_t duration = 0;
    char *comma = strchr(arg, ',');
    if (comma) {
        *comma++ = 0;
        while (*comma == ' ')
            comma++;
        int16_t error = thousandths(comma, 60000000UL, &duration); /* ms in, us out */
        if (error)
            return error;
        if (!duration)
            return E_RANGE;
    }
    if (is(arg, PSTR("OFF"), PSTR("NEUTRAL")))
        return comma ? E_NOT_ALLOWED : valve_set(NEUTRAL, 0);
    if (is(arg, PSTR("EXT"), PSTR("EXTEND")))
        return valve_set(EXTEND, duration);
    if (is(arg, PSTR("RET"), PSTR("RETRACT")))
        return valve_set(RETRACT, duration);
    return E_DATA_TYPE;
}

static int16_t tell_valve(char *arg) {
    (void)arg;
    int8_t position = valve_position();
    put_text(position == EXTEND ? PSTR("EXT") : position == RETRACT ? PSTR("RET") : PSTR("OFF"));
    return E_NONE;
}

static int16_t tell_switches(char *arg) {
    (void)arg;
    uint32_t on, off;
    valve_times(&on, &off);
    put_unsigned(on);
    put(',');
    put_unsigned(off);
    return E_NONE;
}

static int16_t pressure(char *arg) {
    uint32_t counts;
    int16_t error = whole(arg, 1023, &counts);
    return error ? error : pressure_set(counts);
}

static int16_t tell_pressure(char *arg) {
    (void)arg;
    put_unsigned(pressure_counts());
    return E_NONE;
}

static int16_t clear_control(char *arg) {
    (void)arg;
    return control_clear();
}

static int16_t input_of_control(char *arg) {
    uint32_t number;
    int16_t error = whole(arg, 2, &number);
    return error ? error : control_input(number);
}

static int16_t period_of_control(char *arg) {
    uint32_t ms;
    int16_t error = whole(arg, 60000, &ms);
    if (!error && !ms)
        error = E_RANGE;
    return error ? error : control_period(ms);
}

static int16_t start_control(char *arg) {
    char *comma = strchr(arg, ',');
    if (comma)
        *comma++ = 0;
    bool clamped = comma && is(comma, PSTR("CLAM"), PSTR("CLAMPING"));
    if (comma && !clamped)
        return E_DATA_TYPE;
    if (is(arg, PSTR("BUMP"), PSTR("BUMPLESS")))
        return control_start(true, clamped);
    if (is(arg, PSTR("ZERO"), PSTR("ZERO")))
        return control_start(false, clamped);
    return E_DATA_TYPE;
}

static int16_t stop_control(char *arg) {
    (void)arg;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { control_halt(); }
    return E_NONE;
}

static void put_float(float value) {
    char text[16];
    dtostre(value, text, 7, DTOSTR_UPPERCASE);
    for (char *c = text; *c; c++)
        put(*c);
}

static int16_t tell_control(char *arg) {
    (void)arg;
    float setpoint, output;
    control_state(&setpoint, &output);
    put(control_running() ? '1' : '0');
    put(',');
    put_unsigned(pressure_counts());
    put(',');
    put_float(setpoint);
    put(',');
    put_float(output);
    return E_NONE;
}

static int16_t tell_figures(char *arg) {
    (void)arg;
    uint32_t figures[CONTROL_FIGURES];
    control_figures(figures);
    for (uint8_t i = 0; i < CONTROL_FIGURES; i++) {
        if (i)
            put(',');
        put_unsigned(figures[i]);
    }
    return E_NONE;
}

static int16_t stream(char *arg) {
    uint32_t millihertz;
    int16_t error = thousandths(arg, 2000000UL, &millihertz);
    if (error)
        return error;
    if (millihertz && millihertz < 10)
        return E_RANGE;
    stream_set(millihertz ? 1000000000UL / millihertz : 0);
    return E_NONE;
}

static int16_t __attribute__((noreturn)) hang(char *arg) { /* tests the watchdog: the board restarts with outputs off */
    (void)arg;
    for (;;) {
    }
}

/* --- recognition of commands ---------------------------------------------------------------------------------- */
typedef struct {
    char header[24]; /* capitals are the short form, all letters the long one */
    int16_t (*execute)(char *arg);
    bool needs_parameter;
} command_t;

static const command_t COMMANDS[] PROGMEM = {
    {"*IDN?", identify, false},
    {"*CLS", clear_status, false},
    {"*RST", reset, false},
    {"*OPC?", complete, false},
    {"SYSTem:ERRor?", next_error, false},
    {"SYSTem:ERRor:NEXT?", next_error, false},
    {"SYSTem:ERRor:COUNt?", errors, false},
    {"SYSTem:VERSion?", scpi_version, false},
    {"SYSTem:CONFiguration?", configuration, false},
    {"SYSTem:TRIP?", tell_trips, false},
    {"SYSTem:TRIP:CLEar", clear_trips, false},
    {"SYSTem:PING", ping, false},
    {"SYSTem:TIME?", tell_time, false},
    {"MEASure:ALL?", measure_all, false},
    {"OUTPut:HEATer", heater, true},
    {"OUTPut:HEATer?", tell_heater, false},
    {"OUTPut:HEATer:CREDit?", tell_credit, false},
    {"OUTPut:SAFE", all_off, false},
    {"VALVe", valve, true},
    {"VALVe?", tell_valve, false},
    {"VALVe:TIME?", tell_switches, false},
    {"SOURce:PRESsure", pressure, true},
    {"SOURce:PRESsure?", tell_pressure, false},
    {"CONTrol?", tell_control, false},
    {"CONTrol:CLEar", clear_control, false},
    {"CONTrol:INPut", input_of_control, true},
    {"CONTrol:PERiod", period_of_control, true},
    {"CONTrol:PARameter", control_parameter, true},
    {"CONTrol:STARt", start_control, true},
    {"CONTrol:STOP", stop_control, false},
    {"CONTrol:FIGures?", tell_figures, false},
    {"STReaM", stream, true},
    {"DIAGnostic:HANG", hang, false},
};

/* The end of the input's node if it is one form of the header's, otherwise NULL. */
static const char *match_node(const char *header, const char *input, bool long_form) {
    char h;
    while ((h = pgm_read_byte(header)) && h != ':' && h != '?') {
        header++;
        if (islower((unsigned char)h) && !long_form)
            continue;
        if (*input++ != toupper((unsigned char)h))
            return NULL;
    }
    return *input == h ? input : NULL;
}

static bool matches(const char *header, const char *input) {
    for (;;) {
        const char *end = match_node(header, input, false);
        if (!end)
            end = match_node(header, input, true);
        if (!end)
            return false;
        if (!*end)
            return true;
        while (pgm_read_byte(header) != *end)
            header++;
        header++;
        input = end + 1;
        if (*end == '?')
            return !*input;
    }
}

static int16_t dispatch(char *header, char *arg) {
    if (*header == ':')
        header++;
    for (uint8_t i = 0; i < sizeof COMMANDS / sizeof COMMANDS[0]; i++) {
        if (!matches(COMMANDS[i].header, header))
            continue;
        host_spoke(); /* by a command only: noise has lines too */
        bool needed = pgm_read_byte(&COMMANDS[i].needs_parameter);
        if (needed != (arg != NULL))
            return needed ? E_MISSING : E_NOT_ALLOWED;
        int16_t (*execute)(char *) = (int16_t(*)(char *))pgm_read_ptr(&COMMANDS[i].execute);
        return execute(arg);
    }
    return E_HEADER;
}

static int8_t hex_digit(char c) {
    if (c >= '0' && c <= '9')
        return c - '0';
    c = toupper((unsigned char)c);
    return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

/* Removes a checksum from the line's end; false if it is wrong. */
static bool checksum(char *line) {
    char *star = strrchr(line, '*');
    with_crc = false;
    if (!star || star == line || strlen(star) != 5)
        return true;
    uint16_t given = 0, crc = 0;
    for (uint8_t i = 1; i < 5; i++) {
        int8_t digit = hex_digit(star[i]);
        if (digit < 0)
            return true; /* a header such as *IDN? after a tag */
        given = given << 4 | digit;
    }
    with_crc = true;
    for (char *c = line; c < star; c++)
        crc = crc_update(crc, *c);
    *star = 0;
    return crc == given;
}

static char *skip_blanks(char *text) {
    while (*text == ' ' || *text == '\t')
        text++;
    return text;
}

/* Terminates the word at `text` and returns what follows, or NULL. */
static char *split(char *text) {
    while (*text && *text != ' ' && *text != '\t')
        text++;
    if (!*text)
        return NULL;
    *text++ = 0;
    text = skip_blanks(text);
    return *text ? text : NULL;
}

void command_execute(char *line) {
    tag = NULL;
    answered = false;
    if (!checksum(line)) {
        error_add(E_COMMUNICATION);
        return;
    }
    line = skip_blanks(line);
    for (char *end = line + strlen(line); end > line && (end[-1] == ' ' || end[-1] == '\t');)
        *--end = 0;
    for (char *c = line; *c; c++)
        *c = toupper((unsigned char)*c);
    if (*line == '#') {
        tag = line;
        line = split(line);
    }
    if (!line || !*line)
        return;
    char *arg = split(line);
    finish(dispatch(line, arg));
}
