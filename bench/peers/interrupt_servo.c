// Two servo pulses by the usual technique: a timer interrupt writes the port when a pulse must start or
// end. In parallel, another interrupt receives and echoes the bytes of a serial line at 250000 baud.
#include <avr/interrupt.h>
#include <avr/io.h>

enum { FRAME = 40000, PULSE = 3000 };  // 0.5 us

static volatile uint8_t phase;

ISR(TIMER1_COMPA_vect) {
  switch (phase) {
    case 0:
      PORTB |= _BV(1);
      OCR1A += PULSE;
      phase = 1;
      break;
    case 1:
      PORTB &= ~_BV(1);
      PORTB |= _BV(2);
      OCR1A += PULSE;
      phase = 2;
      break;
    default:
      PORTB &= ~_BV(2);
      OCR1A += FRAME - 2 * PULSE;
      phase = 0;
  }
}

ISR(USART_RX_vect) {
  static uint8_t ring[64];
  static uint8_t at;
  ring[at] = UDR0;
  UDR0 = ring[at];
  at = (at + 1) & 63;
}

int main(void) {
  UCSR0A = _BV(U2X0);
  UBRR0 = 7;
  UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
  DDRB = _BV(1) | _BV(2);
  OCR1A = PULSE;
  TIMSK1 = _BV(OCIE1A);
  TCCR1B = _BV(CS11);
  sei();
  for (;;) {
  }
}
