/* Declarations of what teensy.ino calls, to compile it without the Arduino core. */
#include <stddef.h>
#include <stdint.h>

enum { LOW, HIGH, OUTPUT, RISING };
struct SerialPort {
    int available();
    int read();
    int availableForWrite();
    size_t write(const uint8_t *bytes, size_t count);
};
extern SerialPort Serial;
uint32_t micros();
void noInterrupts();
void interrupts();
void pinMode(int pin, int mode);
void digitalWriteFast(int pin, int level);
int digitalPinToInterrupt(int pin);
void attachInterrupt(int interrupt, void (*call)(), int mode);
