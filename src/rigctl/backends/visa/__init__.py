"""An instrument that VISA reaches, by network, USB, GPIB or serial line, spoken to in lines."""
