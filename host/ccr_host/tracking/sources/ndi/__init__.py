"""Driver for NDI Polaris cameras (Vicra and, over TCP, Vega): ASCII protocol, TX replies."""
